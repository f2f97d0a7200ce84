"""A scene of thousands of objects and a hundred thousand instances: what an edit of one of them takes."""

import bpy
import numpy as np
from artist import Artist

NEEDS = ["demo.blend"]
BY_NAME = True
COLLECTIONS = 50
EACH = 100
INSTANCES = 100_000


def add_objects(scene, mesh):
    """Objects that share a mesh, in many collections."""
    for place in range(COLLECTIONS):
        collection = bpy.data.collections.new(f"Row {place}")
        scene.collection.children.link(collection)
        for number in range(EACH):
            obj = bpy.data.objects.new(f"Stone {place} {number}", mesh)
            obj.location, obj.scale = (0.1 * place - 2.5, 0.1 * number - 5.0, -1.0), (0.02, 0.02, 0.02)
            collection.objects.link(obj)


def add_instances(scene, mesh):
    """An object with others on its points."""
    points = bpy.data.meshes.new("Meadow")
    points.vertices.add(INSTANCES)
    points.vertices.foreach_set("co", np.random.default_rng(1).uniform(-3.0, 3.0, 3 * INSTANCES).astype(np.float32))
    meadow, blade = bpy.data.objects.new("Meadow", points), bpy.data.objects.new("Blade", mesh)
    for obj in (meadow, blade):
        scene.collection.objects.link(obj)
    meadow.instance_type, blade.parent, meadow.location.z = "VERTS", meadow, -5.0
    blade.scale = (0.01, 0.01, 0.01)


def play(driver):
    """See the first line of this file."""
    artist = Artist(driver)
    with driver.step("open"):
        yield from artist.open("demo.blend", (160, 90), samples=1, train_seconds=0)
        triangle = bpy.data.meshes.new("Triangle")
        triangle.from_pydata([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [], [(0, 1, 2)])
        add_objects(artist.scene, triangle)
        add_instances(artist.scene, triangle)
        bpy.ops.ed.undo_push(message="Crowd")
        yield from driver.drawn()
    with driver.step("start"):
        yield from artist.start()
        yield from looked_at(driver, artist)
        driver.photo("started")
    light = next(obj for obj in artist.scene.objects if obj.type == "LIGHT")
    with driver.step("drag a light"):
        yield from artist.select(light.name)
        yield from artist.drag(100)
        yield from looked_at(driver, artist)
    edits = {
        "add a light": lambda: bpy.ops.object.light_add(type="POINT", location=(0, 0, 2)),
        "delete it": lambda: bpy.ops.object.delete(),
        "add an object": lambda: bpy.ops.mesh.primitive_cube_add(size=0.1),
        "move the instances": lambda: setattr(artist.scene.objects["Meadow"].location, "x", 0.1),
    }
    for what, edit in edits.items():
        with driver.step(what):
            with driver.within("WINDOW"):
                edit()
            bpy.ops.ed.undo_push(message=what)
            yield from looked_at(driver, artist)
            driver.check(artist.shot.frame, "there is a picture")
    with driver.step("undo"):
        yield from artist.undo()
        yield from looked_at(driver, artist)


def looked_at(driver, artist):
    """Waits until the scene was compared with its bake, and the view shows the present picture."""
    yield from artist.until_settled(600)
    yield from driver.until(lambda: not artist.shot.changes.is_pending, "what has changed", 600)
