"""Plays rounds of one kind in this Blender: `run.py` starts it, so that a crash takes nobody else down.

Prints JSON lines: `at` where a picture comes from next, a `fault` for each round that fails, `played` after the
rounds of a picture.
"""

import argparse
import json
import os
import random
import sys
import traceback
from pathlib import Path

import bpy
import describe
import measure
import simpler
import trees
from kinds import KINDS, Cards

import stage
from addon.engine.reading.render_depsgraph import why_no_picture

MORE_SAMPLES = (1, 4, 16, 64)
"""Times as many in the pictures of a single round that confirm a difference, which noise might have made."""


class Hunt:
    """Rounds of a kind and a seed; each is the same whichever others are in its picture."""

    def __init__(self, name, seed, folder):
        self.name, self.kind, self.seed, self.folder = name, KINDS[name], seed, folder
        self.palette = palettes()

    def random(self, *what):
        """The generator of a round, or of what the rounds of a picture share."""
        return random.Random(f"{self.name} {self.seed} {what}")

    def title(self, number):
        """The name of a round's material and object, by which warnings name it."""
        return f"{self.name} {number}"

    def play(self, numbers):
        """Faults by round. A picture that cannot be made is made in halves, down to the round that prevents it."""
        try:
            return self.compare(numbers)
        except Exception as error:
            if len(numbers) == 1:
                return {} if is_refusal(error) else {numbers[0]: {"fault": "raised", "said": last_line(error)}}
            half = len(numbers) // 2
            return self.play(numbers[:half]) | self.play(numbers[half:])

    def compare(self, numbers, more=1, left_out=frozenset(), change=None):
        """Faults by round of one picture; with `left_out` choices of a shot, or after `change` of what was built."""
        scene = self.build(numbers, left_out)
        if change:
            change()
        tell(at="Relume")
        exported, settings, said = stage.export(scene)
        pictures, more_said = stage.relit(exported, settings, self.kind.samples * more)
        tell(at="Cycles")
        references = stage.rendered(scene, self.kind.samples * more, 2 * more)
        faults = {}
        for number in numbers:
            ours, cycles = ([self.part(number, numbers, p, scene) for p in pair] for pair in (pictures, references))
            fault = measure.worst_block(ours, cycles)
            named = [text for text in [*said, *more_said] if self.is_about(number, text)]
            if fault and not (named and fault["fault"] == "difference"):
                faults[number] = fault
        return faults

    def build(self, numbers, left_out=frozenset()):
        """The scene of some rounds that share a picture."""
        kind = self.kind
        shared = self.random("picture", numbers[0] // kind.in_a_picture)
        if not isinstance(kind, Cards):
            scene = kind.make.prepare(shared)
            for text, choose in self.choices(scene, numbers[0]):
                if text not in left_out:
                    choose()
            return scene
        columns, rows = self.grid(numbers)
        scene = kind.make.prepare(shared, len(columns) * kind.cell, len(rows) * kind.cell)
        middle = (columns[0] + columns[-1] + 1) / 2, kind.rows - (rows[0] + rows[-1] + 1) / 2
        stage.add_camera(scene, (*middle, 10.0), (0, 0, 0), float(len(columns)))
        for number in numbers:
            column, row = self.place(number)
            at = (column + 0.5, kind.rows - row - 0.5)
            kind.make.add(scene, self.random(number), self.palette, self.title(number), *at)
        return scene

    def grid(self, numbers):
        """Columns and rows that a picture shows: those of all rounds, or of the only one."""
        column, row = self.place(numbers[0])
        if len(numbers) == 1:
            return [column], [row]
        return range(self.kind.columns), range(self.kind.rows)

    def choices(self, scene, number):
        """Choices that a shot consists of: pairs of words and the function that makes each."""
        return list(self.kind.make.choices(scene, self.random(number), self.palette))

    def place(self, number):
        """Column and row of a round in its picture, from the top left."""
        number %= self.kind.in_a_picture
        return number % self.kind.columns, number // self.kind.columns

    def part(self, number, numbers, picture, scene):
        """Part of a picture of some rounds that shows one."""
        if not isinstance(self.kind, Cards):
            return measure.region(picture, scene.render)
        columns, rows = self.grid(numbers)
        size, (column, row) = self.kind.cell, self.place(number)
        top, left = (row - rows[0]) * size, (column - columns[0]) * size
        return picture[top : top + size, left : left + size]

    def is_about(self, number, warning):
        """True if a warning names what is in a round."""
        return not isinstance(self.kind, Cards) or f"'{self.title(number)}'" in warning

    def confirm(self, number):
        """The fault of a round that is played alone, with more and more samples; None once there is none."""
        fault = None
        for more in MORE_SAMPLES:
            try:
                fault = self.compare([number], more).get(number)
            except Exception as error:
                fault = {"fault": "raised", "said": last_line(error)}
            if not fault:
                break
        return fault

    def minimal(self, number, fault):
        """Rest of a failing round, in lines, when all is gone without which it fails in the same way."""
        return (self.minimal_tree if isinstance(self.kind, Cards) else self.minimal_shot)(number, fault)

    def minimal_shot(self, number, fault):
        """The choices that make a shot fail."""
        texts = [text for text, _ in self.choices(self.kind.make.prepare(self.random("picture", number)), number)]
        left_out = set()
        for text in texts:
            if self.still_fails(number, fault, left_out=left_out | {text}):
                left_out.add(text)
        self.build([number], left_out)
        trees_of_lamps = [light.node_tree for light in bpy.data.lights if light.node_tree]
        lines = [text for text in texts if text not in left_out]
        return [*lines, *(line for tree in trees_of_lamps for line in describe.tree_lines(tree))]

    def minimal_tree(self, number, fault):
        """The material of a card without the nodes, links and mutes that do not matter."""
        edits = []
        while True:
            before = len(edits)
            for edit in self.possible_edits(number):
                if edit not in edits and self.still_fails(number, fault, change=self.edited(number, [*edits, edit])):
                    edits.append(edit)
            if len(edits) == before:
                break
        self.build([number])
        self.edited(number, edits)()
        return list(describe.tree_lines(self.tree(number)))

    def tree(self, number):
        """The node tree of a card that was built."""
        title = self.title(number)
        return (bpy.data.materials.get(title) or bpy.data.worlds[title]).node_tree

    def possible_edits(self, number):
        """Steps that make a round's tree simpler: calls of functions of `simpler` with what follows the name."""
        self.build([number])
        tree = self.tree(number)
        nodes = [node for node in tree.nodes if not node.bl_idname.startswith("ShaderNodeOutput")]
        return [
            *((simpler.remove, node.name) for node in nodes),
            *((simpler.unlink, link.to_node.name, link.to_socket.identifier) for link in tree.links),
            *((simpler.unmute, node.name) for node in nodes if node.mute),
            *((simpler.reset, node.name, key) for node in nodes for key in describe.changes(tree, node)),
        ]

    def edited(self, number, edits):
        """Function that makes the tree of a built round simpler."""

        def change():
            tree = self.tree(number)
            for edit, node, *more in edits:
                if node in tree.nodes:
                    edit(tree, tree.nodes[node], *more)

        return change

    def still_fails(self, number, fault, **simpler):
        """True if a simpler form of a round fails in the same way."""
        try:
            found = self.compare([number], **simpler).get(number, {"fault": None})
        except Exception as error:
            found = {"fault": "raised", "said": last_line(error)}
        return all(found.get(key) == fault.get(key) for key in ("fault", "said"))

    def keep(self, number):
        """Writes the file of a round; its path."""
        self.build([number])
        path = self.folder / f"{self.name}-{self.seed}-{number}.blend"
        bpy.ops.wm.save_as_mainfile(filepath=str(path), copy=True)
        return path


def palettes():
    """Nodes that give values and nodes that are closures; those that the exporter names whatever they do are loud."""
    kinds = trees.node_kinds()
    groups = {"closures": {kind for kind, types in kinds.items() if "SHADER" in types}}
    groups["values"] = {kind for kind, types in kinds.items() if types & trees.VALUES} - groups["closures"]
    loud = loud_kinds(sorted(groups["closures"] | groups["values"]))
    return {name: trees.Palette(group - loud, group & loud) for name, group in groups.items()}


def loud_kinds(kinds):
    """Those node types that the exporter warns about as they are made. One that it refuses is not loud: a round is to
    find that."""
    scene = stage.empty_scene(8, 8)
    stage.add_camera(scene, (0, 0, 5), (0, 0, 0))
    for kind in kinds:
        stage.add(scene, kind, stage.square(kind, 0.1, showing(kind)))
    try:
        _, _, said = stage.export(scene)
    except Exception:
        half = len(kinds) // 2
        return loud_kinds(kinds[:half]) | loud_kinds(kinds[half:]) if half else set()
    return {kind for kind in kinds if any(f"'{kind}'" in text for text in said)}


def showing(kind):
    """A material of one node, by the name of its type."""
    material, tree, output = stage.new_material(kind)
    node = tree.nodes.new(kind)
    if hasattr(node, "image"):
        node.image = bpy.data.images["grid"]
    shown = next(socket for socket in node.outputs if socket.enabled and socket.type in {"SHADER", *trees.VALUES})
    if shown.type != "SHADER":
        emission = tree.nodes.new("ShaderNodeEmission")
        tree.links.new(shown, emission.inputs["Color"])
        shown = emission.outputs[0]
    tree.links.new(shown, output.inputs["Surface"])
    return material


def is_refusal(error):
    """True if an error is the add-on's own word on why it refuses a scene."""
    return type(error).__name__ == "ExportError" or str(error) == why_no_picture(bpy.context.scene)


def last_line(error):
    """Message of an exception, with where it was raised."""
    frame = traceback.extract_tb(error.__traceback__)[-1]
    return f"{type(error).__name__}: {error} ({Path(frame.filename).name}:{frame.lineno})"


def tell(**record):
    """A line for the parent."""
    print("HUNT " + json.dumps(record), flush=True)


def main():
    """Plays the pictures that it is given."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kind", required=True)
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--pictures", type=json.loads, required=True, help="lists of rounds")
    parser.add_argument("--folder", type=Path, required=True)
    parser.add_argument("--minimise", action="store_true")
    parser.add_argument("--without", nargs="*", default=[])
    args = parser.parse_args()
    trees.CHANCE |= dict.fromkeys(args.without, 0.0)
    args.folder.mkdir(parents=True, exist_ok=True)
    hunt = Hunt(args.kind, args.seed, args.folder)
    for numbers in args.pictures:
        for number, first in hunt.play(numbers).items():
            fault = first if first["fault"] == "raised" else hunt.confirm(number)
            if fault:
                record = {"round": number, **fault, "file": hunt.keep(number).name}
                tell(fault=record | ({"minimal": hunt.minimal(number, fault)} if args.minimise else {}))
        tell(played=numbers)


if __name__ == "__main__":
    main()
    sys.stdout.flush()
    # Blender before 5.0 can crash at exit.
    os._exit(0)
