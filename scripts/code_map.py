"""Who uses whom: imports of the add-on, modules of Rust crates, and circles among them. Reads text, builds nothing."""

import ast
import re
from collections import defaultdict
from functools import cached_property
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
# Comments, strings and characters of Rust; lifetimes stay.
NO_CODE = re.compile(r"""//[^\n]*|/\*.*?\*/|\bb?r(#*)".*?"\1|"(?:\\.|[^"\\])*"|'(?:\\.[^'\n]*|[^\\'\n])'""", re.S)


def circles(arrows):
    """Groups of nodes that reach each other; `arrows` maps each node to those it uses."""
    reached = {}
    for node in arrows:
        found, to_visit = set(), [node]
        while to_visit:
            new = arrows.get(to_visit.pop(), set()) - found
            found |= new
            to_visit += new
        reached[node] = found
    groups = {frozenset(other for other in reached[node] if node in reached[other]) for node in arrows}
    return sorted(sorted(group) for group in groups if len(group) > 1)


def imports_of(path, root=ROOT):
    """Absolute names of what a Python file imports anywhere, "addon.core.rows", "bpy"."""
    package = path.relative_to(root).parent.parts
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else ()
            module = ".".join([*base, *([node.module] if node.module else [])])
            # A name may be a module of a package.
            yield from (f"{module}.{alias.name}" for alias in node.names)


def addon_circles(root=ROOT):
    """Circles of imports in the add-on, those within functions included: between modules, and between packages."""
    files = {}
    for path in sorted((root / "addon").rglob("*.py")):
        parts = path.relative_to(root).with_suffix("").parts
        files[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    of_modules, of_packages = defaultdict(set), defaultdict(set)
    for module, path in files.items():
        for name in imports_of(path, root):
            while name and name not in files:
                name = name.rpartition(".")[0]
            if name and name != module:
                of_modules[module].add(name)
                # A package's own file stands for the package.
                package, used = (".".join(files[one].relative_to(root).parent.parts) for one in (module, name))
                of_packages[package] |= {used} - {package}
    return tuple(circles({node: arrows.get(node, set()) for node in files}) for arrows in (of_modules, of_packages))


def item_end(text, start):
    """End of the Rust item that begins at `start`: behind its block or semicolon. With it, whether it has a block."""
    depth, has_block = 0, False
    for sign in re.compile(r"[][(){};]").finditer(text, start):
        has_block |= sign[0] == "{" and depth == 0
        depth += (sign[0] in "([{") - (sign[0] in ")]}")
        if depth == 0 and (sign[0] == ";" or (sign[0] == "}" and has_block)):
            return sign.end(), has_block
    return len(text), has_block


class RustFile:
    """A file of a crate: its code without comments, strings and test items."""

    def __init__(self, root, name):
        self.name, self.crate = name, name.split("/")[1]
        parts = name.removesuffix(".rs").split("/")[3:]
        self.module = tuple(part for part in parts if part not in ("lib", "main", "mod"))
        self.raw = (root / name).read_text()
        text = NO_CODE.sub(lambda found: re.sub(r"[^\n]", " ", found[0]), self.raw)
        self.is_test = bool(re.search(r"/(tests|examples)/|tests\.rs$", name))
        self.test_modules, pieces, end = [], [], 0
        for found in re.finditer(r"#\[cfg\((?:all\()?test\b.*?\)\]", text):
            if found.start() >= end:
                pieces.append(text[end : found.start()])
                end = item_end(text, found.end())[0]
                self.test_modules += re.findall(r"\bmod\s+(\w+)\s*;", text[found.end() : end])
        self.code = "".join([*pieces, text[end:]])

    @cached_property
    def uses(self):
        """Paths of its `use` declarations: (whether public, its segments, the name they get)."""
        found = re.findall(r"^[ \t]*(pub(?:\([^)]*\))?\s+)?use\s+([^;]+);", self.code, re.M)
        return [(bool(public), *leaf) for public, tree in found for leaf in leaves(tree)]

    @cached_property
    def body(self):
        """Its code without `use` declarations."""
        return re.sub(r"^[ \t]*(?:pub(?:\([^)]*\))?\s+)?use\s+[^;]+;", "", self.code, flags=re.M)


def leaves(tree, before=()):
    """Each path of a `use` tree, as its segments and the name it gets."""
    head, brace, inner = tree.strip().partition("{")
    path, _, alias = head.partition(" as ")
    path = (*before, *re.findall(r"\w+|\*", path))
    if not brace:
        path = path[:-1] if path[-1] == "self" and len(path) > 1 else path
        return [(path, alias.strip() or path[-1])]
    pieces = re.findall(r"(?:[^,{}]|\{(?:[^{}]|\{[^{}]*\})*\})+", inner.rpartition("}")[0])
    return [leaf for piece in pieces if piece.strip() for leaf in leaves(piece, path)]


def rust_circles(files):
    """Circles between modules of a crate; then those left when modules may use the ones that they are in. A name that
    a module only passes on is looked up where it comes from."""
    modules = {file.module: file for file in files}

    def absolute(module, path):
        ups = path.count("super")
        if path[0] in ("crate", "self"):
            return path[1:] if path[0] == "crate" else module + path[1:]
        return module[:-ups] + path[ups:] if ups else module + path if (*module, path[0]) in modules else None

    passed_on = defaultdict(dict)
    for file in files:
        for _, path, alias in file.uses:
            if (target := absolute(file.module, path)) is not None:
                passed_on[file.module][alias] = target

    def home(path, depth=0):
        module = path
        while module not in modules:
            module = module[:-1]
        rest = path[len(module) :]
        target = passed_on[module].get(rest[0]) if rest else None
        return home(target + rest[1:], depth + 1) if target and depth < 8 else module

    every, down = {}, {}
    for file in files:
        named = [path for public, path, alias in file.uses if not public or re.search(rf"\b{alias}\b", file.body)]
        named += [tuple(path.split("::")) for path in re.findall(r"(?<![\w:])[a-z_]\w*(?:::\w+)+", file.body)]
        targets = {home(path) for path in (absolute(file.module, one) for one in named) if path is not None}
        every[file.module] = targets - {file.module}
        down[file.module] = {target for target in targets if file.module[: len(target)] != target}
    return tuple([["::".join(one) or "lib" for one in group] for group in circles(arrows)] for arrows in (every, down))
