"""Steps that make a node tree simpler, as long as it fails without what they take away."""


def remove(tree, node):
    """Takes a node away."""
    tree.nodes.remove(node)


def unlink(tree, node, identifier):
    """Takes the links to an input away."""
    for link in [link for link in tree.links if link.to_node == node and link.to_socket.identifier == identifier]:
        tree.links.remove(link)


def unmute(tree, node):
    """Lets a node take part."""
    node.mute = False


def reset(tree, node, key):
    """Gives a setting, or an input by its identifier, the value that a new node has."""
    fresh = tree.nodes.new(node.bl_idname)
    for mine, usual in zip(node.inputs, fresh.inputs, strict=False):
        if mine.identifier == key:
            mine.default_value = usual.default_value
    if key in node.bl_rna.properties and not node.bl_rna.properties[key].is_readonly:
        setattr(node, key, getattr(fresh, key))
    tree.nodes.remove(fresh)
