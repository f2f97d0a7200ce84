//! Collapse of obvhs's binary tree to ours of eight children a node.
//!
//! Dynamic programming over the surface area cost chooses the inner nodes that disappear, as for the wide trees of
//! Ylitie, Karras and Laine (2017), "Efficient Incoherent Ray Traversal on GPUs Through Compressed Wide BVHs", section
//! 3: `cost(n, k)` is the least cost of the subtree `n` as a forest of at most `k` trees. Testing a block costs the
//! same for one triangle as for eight, so leaves become as full as the areas allow.

use glam::Vec3;
use obvhs::bvh2::{Bvh2, node::Bvh2Node};

use super::tree::{BvhNode, Child, Growing, WIDTH};

/// Cost of testing a node's eight boxes.
const NODE_COST: f32 = 1.0;

/// Source of the primitives of the binary tree.
pub(super) trait Primitives {
    /// Cost of testing a block's eight primitives, relative to [`NODE_COST`].
    const BLOCK_COST: f32;
    /// True if the primitive can share a block with others.
    fn is_packed(&self, primitive: u32) -> bool;
    /// Appends a block of up to eight primitives, each once, and returns its entry; that of the first one if it is not packed.
    fn write_leaf(&self, primitives: &[u32], tree: &mut Growing) -> Child;
}

/// Cut of a subtree: `cost[k - 1]` for at most `k` trees, and how many of them the left child gets.
#[derive(Clone, Copy, Default)]
struct Cut {
    cost: [f32; WIDTH],
    /// Trees for the left child when the subtree becomes `k` trees; 0 means: as for `k - 1`.
    left: [u8; WIDTH],
    /// True if the whole subtree becomes one block.
    is_leaf: bool,
    /// Primitives below, at most [`WIDTH`] + 1; 0 if one cannot share a block.
    packed: u8,
}

/// Appends the tree of `binary` to `tree` and returns its root and the depth of its stack.
pub(super) fn collapse(
    binary: &mut Bvh2,
    primitives: &impl Primitives,
    tree: &mut Growing,
) -> Option<(Child, usize)> {
    if binary.nodes.is_empty() || binary.primitive_indices.is_empty() {
        return None;
    }
    binary.reorder_in_stack_traversal_order();
    let cuts = plan(binary, primitives);
    let mut writer = TreeWriter { binary, primitives, cuts: &cuts, tree, deepest: 0 };
    let root = writer.write_root();
    Some((root, writer.deepest * (WIDTH - 1) + 1))
}

/// Bottom-up: children come after their parents in the array.
fn plan<P: Primitives>(binary: &Bvh2, primitives: &P) -> Vec<Cut> {
    let mut cuts = vec![Cut::default(); binary.nodes.len()];
    for index in (0..binary.nodes.len()).rev() {
        let node = &binary.nodes[index];
        cuts[index] = if node.is_leaf() {
            let is_packed = primitives.is_packed(leaf_primitive(binary, node));
            Cut {
                cost: [node.aabb().half_area() * P::BLOCK_COST; WIDTH],
                left: [0; WIDTH],
                is_leaf: true,
                packed: u8::from(is_packed),
            }
        } else {
            let first = node.first_index as usize;
            inner_cut(node.aabb().half_area(), P::BLOCK_COST, &cuts[first], &cuts[first + 1])
        };
    }
    cuts
}

fn inner_cut(area: f32, block_cost: f32, left: &Cut, right: &Cut) -> Cut {
    let mut cut = Cut::default();
    if left.packed > 0 && right.packed > 0 {
        cut.packed = (left.packed + right.packed).min(WIDTH as u8 + 1);
    }
    // For k trees, k - 1 of them shared out between the children.
    let share = |k: usize| {
        (1..k)
            .map(|left_share| (left.cost[left_share - 1] + right.cost[k - left_share - 1], left_share as u8))
            .min_by(|a, b| a.0.total_cmp(&b.0))
            .unwrap_or((f32::INFINITY, 0))
    };
    let (opened, opened_left) = share(WIDTH);
    let as_node = opened + area * NODE_COST;
    let as_leaf = area * block_cost;
    cut.is_leaf = cut.packed > 0 && usize::from(cut.packed) <= WIDTH && as_leaf <= as_node;
    cut.cost[0] = if cut.is_leaf { as_leaf } else { as_node };
    cut.left[0] = opened_left;
    for k in 2..=WIDTH {
        let (cost, left_share) = share(k);
        let keep = cut.cost[k - 2] <= cost;
        cut.cost[k - 1] = if keep { cut.cost[k - 2] } else { cost };
        cut.left[k - 1] = if keep { 0 } else { left_share };
    }
    cut
}

fn leaf_primitive(binary: &Bvh2, node: &Bvh2Node) -> u32 {
    binary.primitive_indices[node.first_index as usize]
}

struct TreeWriter<'a, P> {
    binary: &'a Bvh2,
    primitives: &'a P,
    cuts: &'a [Cut],
    tree: &'a mut Growing,
    deepest: usize,
}

impl<P: Primitives> TreeWriter<'_, P> {
    fn write_root(&mut self) -> Child {
        let index = self.tree.nodes.len();
        self.tree.nodes.push(BvhNode::empty());
        if self.cuts[0].is_leaf {
            let child = self.write_leaf(0);
            self.fill(index, 0, 0, child);
            self.deepest = 1;
        } else {
            self.write_node(index, 0, 1);
        }
        Child::node(index)
    }

    /// Fills the node `index` with the forest of eight trees below `source`. Nodes that are siblings lie side
    /// by side.
    fn write_node(&mut self, index: usize, source: usize, depth: usize) {
        self.deepest = self.deepest.max(depth);
        let first = self.binary.nodes[source].first_index as usize;
        let mut roots = Vec::with_capacity(WIDTH);
        let left = usize::from(self.cuts[source].left[0]);
        self.gather_roots(first, left, &mut roots);
        self.gather_roots(first + 1, WIDTH - left, &mut roots);

        let mut inner = Vec::with_capacity(WIDTH);
        for (slot, &root) in roots.iter().enumerate() {
            let child = if self.cuts[root].is_leaf {
                self.write_leaf(root)
            } else {
                let node = self.tree.nodes.len();
                self.tree.nodes.push(BvhNode::empty());
                inner.push((node, root));
                Child::node(node)
            };
            self.fill(index, slot, root, child);
        }
        for (node, root) in inner {
            self.write_node(node, root, depth + 1);
        }
    }

    /// The roots of the forest of at most `k` trees that `source` is cut into.
    fn gather_roots(&self, source: usize, mut k: usize, roots: &mut Vec<usize>) {
        let cut = &self.cuts[source];
        while k > 1 && cut.left[k - 1] == 0 {
            k -= 1;
        }
        if k == 1 {
            roots.push(source);
        } else {
            let first = self.binary.nodes[source].first_index as usize;
            let left = usize::from(cut.left[k - 1]);
            self.gather_roots(first, left, roots);
            self.gather_roots(first + 1, k - left, roots);
        }
    }

    fn fill(&mut self, node: usize, slot: usize, source: usize, child: Child) {
        let bounds = self.binary.nodes[source].aabb();
        let [min, max] = [bounds.min, bounds.max].map(|v| Vec3::from_array(v.to_array()));
        self.tree.nodes[node].set(slot, min, max, child);
    }

    fn write_leaf(&mut self, source: usize) -> Child {
        let mut found = Vec::with_capacity(WIDTH);
        self.gather_primitives(source, &mut found);
        // Spatial splits refer to one triangle from several leaves.
        found.sort_unstable();
        found.dedup();
        self.primitives.write_leaf(&found, self.tree)
    }

    fn gather_primitives(&self, source: usize, found: &mut Vec<u32>) {
        let node = &self.binary.nodes[source];
        if node.is_leaf() {
            found.push(leaf_primitive(self.binary, node));
        } else {
            self.gather_primitives(node.first_index as usize, found);
            self.gather_primitives(node.first_index as usize + 1, found);
        }
    }
}
