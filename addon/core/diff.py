"""Differences between a scene and its bake, in words.

A fingerprint is a small value that changes with a part of the scene. Those of a bake lie beside it:
`{"object Sofa": {"place": "1f2e"}, "world": ...}`."""

from __future__ import annotations

from collections.abc import Iterable

Fingerprint = dict[str, str]

EDITED: Fingerprint = {"edited": ""}
"""Fingerprint of a part of the scene that was edited before its own was taken."""

PARTS = {
    ("object", "place"): "'{name}' moved",
    ("object", "data"): "'{name}' has other data",
    ("object", "modifiers"): "Modifiers of '{name}' changed",
    ("object", "details"): "Modifiers of '{name}' changed",
    ("object", "materials"): "'{name}' has other materials",
    ("object", "visibility"): "Visibility of '{name}' changed",
    ("object", "scatter"): "Visibility of '{name}' changed",
    ("object", "culling"): "Culling of '{name}' was switched on or off",
    ("settings", "culling"): "Culling of Simplify changed",
    ("object", "linking"): "Light linking of '{name}' was changed",
    ("object", "holdout"): "Holdout of '{name}' was switched on or off",
    ("object", "catcher"): "Shadow Catcher of '{name}' was switched on or off",
    ("object", "occlusion"): "Fast GI's distance of '{name}' changed",
    ("object", "shading"): "Colour, pass index or shadow terminator of '{name}' changed",
    ("object", "attributes"): "Custom properties of '{name}' changed",
    ("object", "subdivision"): "Adaptive subdivision of '{name}' changed",
    ("object", "motion"): "Motion blur settings of '{name}' changed",
    ("object", "pose"): "'{name}' has another pose",
    ("data", "shape"): "Geometry '{name}' changed",
    ("data", "details"): "Geometry '{name}' changed",
    ("volume", "settings"): "Settings of volume '{name}' changed",
    ("volume", "file"): "The file of volume '{name}' changed",
    ("nodes", "nodes"): "Node group '{name}' changed",
    ("texture", "settings"): "Texture '{name}' changed",
    ("particles", "settings"): "Particle settings '{name}' changed",
    ("collection", "objects"): "Collection '{name}' has other objects",
    ("material", "nodes"): "Material '{name}' changed",
    ("material", "sampling"): "Material '{name}' changed",
    ("image", "file"): "The file of image '{name}' changed",
    ("image", "tiles"): "Image '{name}' has other tiles",
    ("world", "shape"): "The world changed",
    ("world", "color"): "The world changed",
    ("space", "volume"): "The volume of the world changed",
    ("camera", "place"): "The camera moved",
    ("camera", "lens"): "Lens or focus of the camera changed",
    ("settings", "paths"): "Bounces, filters or film of the render settings changed",
    ("settings", "dicing"): "The dicing camera or dicing rates of adaptive subdivision changed",
    ("settings", "override"): "The view layer has another material override",
    ("settings", "surfaces"): "The view layer shows surfaces, or no longer does",
    ("settings", "volumes"): "The view layer shows volumes, or no longer does",
    ("settings", "strands"): "The shape of hair changed, or the view layer hides or shows it",
    ("motion", "shutter"): "Motion blur or its shutter changed",
    ("motion", "frame"): "Another frame is shown, and motion blur follows it",
    ("motion", "animation"): "An animation that motion blur follows changed",
    ("rules", "lights"): "Shadow linking, bounces or Multiple Importance of a light changed",
    ("settings", "space"): "The file has another working space",
    ("collections", "hidden"): "Objects were hidden or shown by their collection",
    ("collections", "lacking"): "Objects were hidden or shown by their collection",
    ("instanced", "lacking"): "Objects of collection '{name}' were hidden or shown",
    ("collections", "rays"): "Holdout or Indirect Only of a collection changed",
    ("collections", "origins"): "The origin of an instanced collection moved",
}
"""Sentence for each part that differs. A `helper`, which no render shows itself, uses those of an `object`."""
LATER = {"details", "dicing", "origins", "lacking", "shading", "override", "volumes"}
"""Parts that the first bakes do not have: there they make no sentence."""
ORDER = (
    *(
        "camera",
        "film",
        "settings",
        "rules",
        "collections",
        "motion",
        "world",
        "space",
        "object",
        "helper",
        "collection",
        "instanced",
        "nodes",
    ),
    *("texture", "particles", "data", "volume", "material", "image", "sequences", "smoke"),
)


def sentences(keys: Iterable[str], baked: dict[str, Fingerprint], present: dict[str, Fingerprint]) -> list[str]:
    """Sentences for the keys that differ, the most general first. A key that only one side has is a difference for
    objects only: materials and data come and go with them."""
    ordered = sorted(keys, key=lambda key: ORDER.index(key.partition(" ")[0]))
    differences = [sentence for key in ordered for sentence in _of_one(key, baked.get(key), present.get(key))]
    return list(dict.fromkeys(differences))


def _of_one(key: str, baked: Fingerprint | None, present: Fingerprint | None) -> list[str]:
    kind, _, name = key.partition(" ")
    if baked is None or present is None:
        return [f"'{name}' was {'added' if baked is None else 'deleted or hidden'}"] if kind == "object" else []
    if baked == EDITED:
        return [f"'{name}' was edited while the bake began"]
    parts = [part for part in {**baked, **present} if baked.get(part) != present.get(part)]
    parts = [part for part in parts if part in baked or part not in LATER]
    if kind == "camera" and "name" in parts:
        return [f"The camera is '{present.get('name')}' now; the bake is of '{baked.get('name')}'"]
    if kind == "motion" and "shutter" in parts:
        parts = ["shutter"]
    if kind == "film":
        return [f"The picture has {present.get('size')} pixels now; the bake has {baked.get('size')}"]
    if kind == "sequences":  # Images come and go with materials.
        both = baked.keys() & present.keys()
        return [f"Image '{image}' shows another picture in this frame" for image in parts if image in both]
    if kind == "smoke":
        both = baked.keys() & present.keys()
        return [f"The smoke of '{domain}' is that of another frame" for domain in parts if domain in both]
    if parts == ["color"] and world_gain(baked, present):
        return []
    said_as = "object" if kind == "helper" else kind
    return [PARTS[said_as, part].format(name=name) for part in parts if (said_as, part) in PARTS]


def world_gain(baked: Fingerprint | None, present: Fingerprint | None) -> list[float] | None:
    """Factor on the baked light of the world, where only its colour changed; else None."""
    if not baked or not present or baked.get("shape") != present.get("shape"):
        return None
    return gain_between(*([float(channel) for channel in side["color"].split()] for side in (baked, present)))


def color_text(color: Iterable[float]) -> str:
    """Text of a colour, as in a fingerprint."""
    return " ".join(f"{channel:.9g}" for channel in color)


def gain_between(before: list[float], now: list[float]) -> list[float] | None:
    """Factor from one colour to the other; None where a channel was zero and no longer is.

    It is 0 if the other is black, and 1 for channels that stay zero."""
    if any(old <= 0.0 < new for old, new in zip(before, now, strict=True)):
        return None
    if not any(now):
        return [0.0] * len(now)
    return [new / old if old > 0.0 else 1.0 for old, new in zip(before, now, strict=True)]
