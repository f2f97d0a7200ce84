"""Random sphere lights to be found again, and how far found ones are from them."""

import math
import random

IDENTITY = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
FREE = ("position", "size", "color", "strength")


def sphere(name, center, radius, radiance):
    """A point light as `relume.solve` describes it for Blender: power P = 4 pi^2 r^2 radiance."""
    strength = max(radiance)
    return {
        "name": name,
        "type": "POINT",
        "world_from_object": [[*IDENTITY[i], center[i]] for i in range(3)] + [[0.0, 0.0, 0.0, 1.0]],
        "energy": 4 * math.pi**2 * radius**2 * strength,
        "color": [channel / strength for channel in radiance],
        "radius": radius,
        "use_soft_falloff": False,
    }


def random_spheres(judge, space, seed, count):
    """Seeded sphere lights: places in sight of the camera, log-uniform radii, colours 0.4..1; together about as bright
    whatever their number."""
    rng = random.Random(seed)
    places = judge.places(seed=seed, count=count, space=space)
    low, high = space["size"]
    distance = math.dist(space["min"], space["max"]) / 3
    lights = []
    for number, center in enumerate(places):
        radius = low * (high / low) ** rng.random()
        radiance = rng.uniform(0.5, 2.0) * distance**2 / radius**2 / count
        lights.append(sphere(f"Light {number + 1}", center, radius, [radiance * rng.uniform(0.4, 1) for _ in "rgb"]))
    return lights


def shape_of(light):
    """(centre, radius, radiance) of a description for Blender."""
    center, radius = [row[3] for row in light["world_from_object"][:3]], light["radius"]
    power = 4 * math.pi**2 * radius**2
    return center, radius, [light["energy"] * channel / power for channel in light["color"]]


def parameter_error(found, wanted, space):
    """Mean difference of the seven parameters of lights given as (centre, radius, radiance): position and radius as
    shares of their bounds, power by channel as a share of the wanted light's largest. Each wanted light is compared
    with the nearest found one that is left; one without any counts as 1."""
    left, errors = list(found), []
    for center, radius, radiance in wanted:
        if not left:
            errors.append(1.0)
            continue
        nearest = min(left, key=lambda light: math.dist(light[0], center))
        left.remove(nearest)
        ends = zip(nearest[0], center, space["min"], space["max"], strict=True)
        parts = [abs(a - b) / (high - low) for a, b, low, high in ends]
        parts.append(abs(nearest[1] - radius) / (space["size"][1] - space["size"][0]))
        size = (nearest[1] / radius) ** 2
        parts += [abs(a * size - b) / max(radiance) for a, b in zip(nearest[2], radiance, strict=True)]
        errors.append(sum(parts) / len(parts))
    return sum(errors) / len(errors)


def spheres_of(light_set):
    """(centre, radius, radiance) of the sphere lights of a light set."""
    shapes = [(light["shape"], light["radiance"]) for light in light_set["lights"]]
    return [(shape["center"], shape["radius"], radiance) for shape, radiance in shapes if shape["type"] == "sphere"]
