"""Reads light objects; `relume_scene::BlenderLight` gives the numbers their meaning."""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Callable
from typing import Any

import bpy
from mathutils import Vector

from .lamp_shaders import Emission, LampShaders
from .linking import LightLinking, receiver_names
from .materials.constants import VaryingNodeError

WHITE = [1.0, 1.0, 1.0]
VARYING = {
    "ShaderNodeTexIES": "is an IES profile",
    "ShaderNodeTexImage": "is an image",
    "ShaderNodeTexEnvironment": "is an image",
    "ShaderNodeLightFalloff": "changes its falloff with distance",
    "ShaderNodeLightPath": "depends on the length or depth of rays",
    "ShaderNodeWavelength": "is a colour by its wavelength",
}
"""Reasons why a node makes a light vary, by type of node."""
MIN_SIZE = 0.01
"""`relume_scene::MIN_SIZE`, metres."""
ALL_BOUNCES = 1024
"""Bounces of a light in Cycles, unless somebody has set fewer: no scene has more."""
NARROW_SPREAD = math.radians(15.0)
"""Spread of an area light below which it is noisy: at 512 paths a pixel, noise is 19 % of its light (p95) at 11
degrees, and 6 % at 20 degrees."""


def name_of(block: bpy.types.ID) -> str:
    """Name of a light or collection in pictures, rows and looks: libraries may have their own of a name."""
    return block.name_full if block.library else block.name


class UniqueNames:
    """Gives each instance of a light a name of its own: "Bulb", "Bulb#2"."""

    def __init__(self) -> None:
        """Starts with no name taken."""
        self._counts: dict[str, int] = {}

    def __call__(self, name: str) -> str:
        count = self._counts[name] = self._counts.get(name, 0) + 1
        return name if count == 1 else f"{name}#{count}"


class LightExporter:
    """Describes every light that can be represented, under a name of its own, and names the others."""

    def __init__(
        self,
        add: Callable[[dict[str, Any]], None],
        warn: Callable[[str], None],
        linking: LightLinking,
        shaders: LampShaders,
    ):
        """Passes descriptions of lights to `add`, and messages about them to `warn`."""
        self.add = add
        self.warn = warn
        self.linking = linking
        self.shaders = shaders
        self.unique = UniqueNames()
        self.not_on_catchers: dict[str, None] = {}
        """Names of lights that Cycles keeps from shadow catchers."""

    def export(
        self, obj: bpy.types.Object, owner: bpy.types.Object, world_from_object: Any, camera: bpy.types.Object | None
    ) -> None:
        """Adds one light, or one instance that its owner makes of it."""
        description = describe_light(obj, owner, world_from_object, camera, self.linking, self.warn, self.shaders)
        if description is not None:
            self.add(description | {"name": self.unique(name_of(obj.original))})
            if not obj.is_shadow_catcher:
                self.not_on_catchers[obj.name] = None


def describe_light(
    obj: bpy.types.Object,
    owner: bpy.types.Object,
    world_from_object: Any,
    camera: bpy.types.Object | None,
    linking: LightLinking,
    warn: Callable[[str], None],
    shaders: LampShaders,
) -> dict[str, Any] | None:
    """JSON form of `BlenderLight`; None for a light that cannot be represented. `owner` is its instancer, or the light
    itself; the camera looks at it."""
    light = obj.data
    if is_portal(light):
        return None
    emission = _emission(obj, world_from_object, warn, shaders)
    if emission is None:
        return None
    problem = _problem(light, world_from_object)
    if problem:
        warn(f"light '{obj.name}': {problem}; left out")
        return None
    _warn_about(obj, warn)
    description = {
        "name": obj.name,
        "world_from_object": [list(row) for row in world_from_object],
        "kind": light_kind(light),
        "energy": light.energy,
        "color": list(light.color),
        "exposure": getattr(light, "exposure", 0.0),
        "temperature_color": temperature_color(light),
        "emission": emission.color,
        "normalize": getattr(light, "normalize", True),
        "lobes": ray_visibility(obj, owner),
    }
    if _may_be_small(light, world_from_object) and camera is not None:
        description["least_size"] = _least_size(world_from_object, camera)
    if emission.table is not None:
        description["map"] = emission.table
    receivers = linking.receivers(obj)
    if receivers is not None:
        description["receivers"] = {"receivers": receivers}
    if rules := light_rules(obj, linking.blockers(obj)):
        description["rules"] = rules
    return description


def light_rules(obj: bpy.types.Object, blockers: list[int] | None) -> dict[str, Any]:
    """JSON form of `LightRules` without what is as usual; `blockers` are those of its shadow linking, None without."""
    cycles = getattr(obj.data, "cycles", None)
    rules: dict[str, Any] = {}
    if cycles is not None and cycles.max_bounces < ALL_BOUNCES:
        rules["max_bounces"] = cycles.max_bounces
    if cycles is not None and not cycles.use_multiple_importance_sampling:
        rules["is_sampled_only"] = True
    if not obj.data.use_shadow:
        blockers = []
    if blockers is not None:
        rules["blockers"] = {"receivers": blockers}
    return rules


def rules_of_lights(scene: bpy.types.Scene) -> list[str]:
    """Rules of the lights of a scene that its bakes have to know of, as JSON, each once."""
    lights = [obj for obj in scene.objects if obj.type == "LIGHT" and not obj.hide_render]
    linking = LightLinking(receiver_names(scene), lambda _message: None)
    rules = (light_rules(obj, linking.blockers(obj)) for obj in lights)
    return sorted({json.dumps(found) for found in rules if found})


def _may_be_small(light: bpy.types.Light, world_from_object: Any) -> bool:
    """True if its size may be below the least that lights are given where nothing is known of the scene."""
    if light.type != "AREA":
        return light.type != "SUN" and light.shadow_soft_size < MIN_SIZE
    sizes = (light.size, light.size_y if light.shape in {"RECTANGLE", "ELLIPSE"} else light.size)
    scales = (math.hypot(*(row[axis] for row in world_from_object[:3])) for axis in (0, 1))
    return min(size * scale for size, scale in zip(sizes, scales, strict=True)) < MIN_SIZE


def _least_size(world_from_object: Any, camera: bpy.types.Object) -> float:
    """A size that cannot be told from a smaller one: a thousandth of the distance to the camera. A power of two, so
    that it is seldom another when something moves."""
    place = Vector(row[3] for row in world_from_object[:3])
    distance = (place - camera.matrix_world.translation).length
    return min(MIN_SIZE, 2.0 ** math.floor(math.log2(max(distance, 1e-9) / 1000.0)))


def ray_visibility(obj: bpy.types.Object, owner: bpy.types.Object) -> dict[str, float]:
    """JSON form of `Lobes`: of rays that see both a light and its instancer, as in Cycles since its lights are
    geometry."""
    if bpy.app.version < (4, 5, 0):
        owner = obj
    return {
        "camera": float(obj.visible_camera and owner.visible_camera),
        "diffuse": float(obj.visible_diffuse and owner.visible_diffuse),
        "glossy": float(obj.visible_glossy and owner.visible_glossy),
        "transmission": float(obj.visible_transmission and owner.visible_transmission),
        "volume": float(obj.visible_volume_scatter and owner.visible_volume_scatter),
    }


def _problem(light: bpy.types.Light, world_from_object: Any) -> str:
    """Reason why a light cannot shine; None if it can. Lengths of the columns of its matrix are its scale."""
    columns = list(zip(*(row[:3] for row in world_from_object[:3]), strict=True))
    places = [row[3] for row in world_from_object[:3]]
    if not all(math.isfinite(value) for value in (light.energy, *light.color, *places, *itertools.chain(*columns))):
        return "one of its values is not a number"
    if light.type != "POINT" and not all(any(column) for column in columns):
        return "its scale is zero"
    if _is_flat(light, columns):
        return "its transform makes it flat"
    return ""


def _is_flat(light: bpy.types.Light, columns: list[Any]) -> bool:
    """True if the axes that give a light its shape do not span it."""
    x, y, z = (Vector(column).normalized() for column in columns)
    across = x.cross(y)
    return (light.type == "AREA" and across.length < 2e-3) or (light.type == "SPOT" and abs(across @ z) < 2e-6)


def _warn_about(obj: bpy.types.Object, warn: Callable[[str], None]) -> None:
    cycles = getattr(obj.data, "cycles", None)
    problems = (
        (
            obj.data.type == "AREA" and obj.data.spread < NARROW_SPREAD,
            "few paths find a spread below 15 degrees; its light in fog, on shiny surfaces and behind glass is grainy",
        ),
        (
            cycles is not None and cycles.is_caustics_light,
            "shadow caustics are not supported; its caustics are those of ordinary paths",
        ),
    )
    for has_problem, problem in problems:
        if has_problem:
            warn(f"light '{obj.name}': {problem}")


def is_portal(light: bpy.types.Light) -> bool:
    """True if a light only guides Cycles' sampling and emits nothing itself."""
    return light.type == "AREA" and bool(getattr(light, "cycles", None) and light.cycles.is_portal)


def _emission(
    obj: bpy.types.Object, world_from_object: Any, warn: Callable[[str], None], shaders: LampShaders
) -> Emission | None:
    """Emission of the light's nodes; None if they emit nothing, or what cannot be represented."""
    try:
        emission = shaders.emission(obj, world_from_object, warn)
    except VaryingNodeError as error:
        node = error.node
        reason = VARYING.get(node.bl_idname, "makes it shine differently by place, direction or distance")
        problem = f"its node '{node.name}' ({node.bl_label}) {reason}, which is not supported yet"
        warn(f"light '{obj.name}': {problem}; left out")
        return None
    if emission is None:
        warn(f"light '{obj.name}': its nodes emit nothing; left out")
    elif emission.table is not None and obj.data.type == "AREA" and _is_sheared(world_from_object):
        warn(f"light '{obj.name}': its parent shears it, which its texture would not follow; left out")
        return None
    return emission


def _is_sheared(world_from_object: Any) -> bool:
    """True if the axes of a transform are not perpendicular."""
    axes = [Vector(row[column] for row in world_from_object[:3]).normalized() for column in range(3)]
    return any(abs(axes[a] @ axes[b]) > 1e-4 for a, b in ((0, 1), (1, 2), (2, 0)))


def light_kind(light: bpy.types.Light) -> dict[str, Any]:
    """The JSON form of `BlenderLightKind`."""
    if light.type == "SUN":
        return {"type": "SUN", "angle": light.angle}
    if light.type == "AREA":
        size_y = light.size_y if light.shape in {"RECTANGLE", "ELLIPSE"} else light.size
        return {"type": "AREA", "shape": light.shape, "size": light.size, "size_y": size_y, "spread": light.spread}
    kind = {"type": light.type, "radius": light.shadow_soft_size, "soft_falloff": light.use_soft_falloff}
    if light.type == "SPOT":
        kind |= {"spot_size": light.spot_size, "spot_blend": light.spot_blend}
    return kind


def temperature_color(light: bpy.types.Light) -> list[float]:
    """Blackbody tint of Blender 4.5 and later; white before and where it is off."""
    if getattr(light, "use_temperature", False):
        return list(light.temperature_color)
    return WHITE
