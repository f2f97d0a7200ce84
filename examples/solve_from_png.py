"""Gives a shot the lighting of an edited picture:

    python examples/solve_from_png.py shot.blend bake/ edited.png --out solved.blend

`edited.png` is a paint-over of the shot's picture, or what any other program made of it, in the camera's frame and as
the scene displays it (an OpenEXR file is read as scene-linear light). All lights of the file may change; the bake is
made if it is not there yet. Runs in a Python with `bpy` and `relume`. See `--help` for locks, new lights and moods.
"""

import argparse
import json
import os
import subprocess
import sys
from pathlib import Path

import bpy
import numpy as np
import relume

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from addon.apply import new_lights  # noqa: E402
from addon.apply.free_moves import FreeMoves  # noqa: E402
from addon.apply.look_lights import light_state, restore_lights  # noqa: E402
from addon.core import solve  # noqa: E402
from addon.engine.reading.scene_lights import SceneLights  # noqa: E402
from addon.engine.shot import record  # noqa: E402
from addon.export.lights import name_of  # noqa: E402
from addon.export.target import TargetError, pixels_of, read_target  # noqa: E402


def bake(blend, folder):
    """Bakes the shot where there is no whole bake yet."""
    if (folder / "manifest.json").exists():
        done, wanted = relume.info(folder)["shards"]
        if done == wanted:
            return
    command = [sys.executable, ROOT / "relume_bake.py", blend, "--", "bake", "--out", folder, "--resume"]
    subprocess.run([str(word) for word in command], check=True)


def present_lights(scene, folder):
    """The lights of the open file, as the solver reads them; light linking counts objects as the bake does."""
    kept = record.read(folder)
    receivers = kept.receivers if kept else [obj.name_full for obj in scene.objects]
    lights = SceneLights(bpy.context.view_layer.name, receivers)
    lights.read(bpy.context.evaluated_depsgraph_get())
    warn(lights.warnings)
    return lights


def warn(messages):
    """Tells what is not as it should be."""
    for message in messages:
        print(f"Warning: {message}")


def light_objects(scene):
    """The light objects of the scene, by the names that they have in pictures."""
    return {name_of(obj): obj for obj in scene.objects if obj.type == "LIGHT"}


def free_moves(scene, lights, args):
    """Parameters of each light that may change, less those that could not be written back."""
    shown = [light["name"] for light in lights.descriptions]
    unknown = ", ".join(set(args.lights or ()) - set(shown))
    if unknown:
        sys.exit(f"solve_from_png: the shot has no light {unknown}; there are {', '.join(shown) or 'none'}")
    objects = light_objects(scene)
    moves, free = FreeMoves(scene, objects.values(), lights.instanced), {}
    for name in args.lights or shown:
        if name in objects:
            reason, free[name] = moves.of(objects[name], args.free)
            warn([f"light '{name}' {reason}: that stays as it is"] if reason else [])
    return free


def request(lights, free, args):
    """Request to the solver."""
    shown = {"lights": lights, "gains": {}, "world": [1, 1, 1], "static": [1, 1, 1]}
    goal = {"goal": "target", "image": "target", "exposure_invariant": args.mood, "where": {"mask": "unclipped"}}
    options = solve.SolveOptions(free=free, goals=[goal], keep_rest=0.0, add_count=args.add, starts=args.starts)
    return solve.request(shown, options)


def unclipped(image, target):
    """Weights [height, width, 1] of a target's pixels: 0 where a picture of few bits shows its white, which only says
    that it is at least as bright."""
    clipped = target.max(axis=2, keepdims=True) >= 0.99 * target.max()
    return np.where(clipped & (not image.is_float), 0.0, 1.0).astype(np.float32)


def write(scene, answer, lights, asked):
    """Makes the scene's lights what the answer says: changed ones, new ones in a collection "Relume". `lights` are
    those that were there, and `asked` the request that was made of them."""
    objects = light_objects(scene)
    present = {name: light_state(obj) for name, obj in objects.items()}
    states = solve.solved(answer, present, lights, asked["lights"], bpy.data.objects.keys()).states
    made = new_lights.make(scene, [state for state in states if state.get("added")])
    restore_lights([*objects.values(), *made], states)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("blend", type=Path)
    parser.add_argument("bake", type=Path, help="bake folder of the shot; made if it is not there")
    parser.add_argument("picture", type=Path, help="what the shot is to look like")
    parser.add_argument("--out", type=Path, default=Path("solved.blend"))
    parser.add_argument("--lights", nargs="+", help="lights that may change; default: all")
    parser.add_argument(
        "--free", nargs="+", default=["position", "direction", "color", "strength"], help="what of them"
    )
    parser.add_argument("--add", type=int, default=0, help="most new lights")
    parser.add_argument("--mood", action="store_true", help="match colours and contrast, not the exposure")
    parser.add_argument("--starts", type=int, default=4, help="more find better answers, in more time")
    args = parser.parse_args()

    try:
        run(args)
    except (TargetError, relume.RelumeError, RuntimeError, OSError) as error:
        sys.exit(f"solve_from_png: {error}")


def run(args):
    """Reads, solves, writes."""
    bpy.ops.wm.open_mainfile(filepath=str(args.blend.resolve()))
    bpy.ops.preferences.addon_enable(module="cycles")
    scene = bpy.context.scene
    bake(args.blend, args.bake)
    manifest = json.loads((args.bake / "manifest.json").read_text())
    image = bpy.data.images.load(str(args.picture.resolve()))
    target, how, _ = read_target(scene, pixels_of(image), "AUTO", (manifest["width"], manifest["height"]))
    print(how)
    images = {"target": target, "unclipped": unclipped(image, target)}
    present = present_lights(scene, args.bake)
    lights = present.descriptions
    asked = request(lights, free_moves(scene, present, args), args)
    job = relume.solve([str(args.bake)], json.dumps(asked), images)
    answer = job.wait(on_warning=print)
    for row in answer["report"]:
        print(row["text"])
    warn(answer["warnings"])
    if answer["rarely_met"]:
        few = ", ".join(answer["rarely_met"])
        warn([f"few paths of the bake meet {few} where they are now: bake {args.out} anew and run this on it again"])
    write(scene, answer, lights, asked)
    bpy.ops.wm.save_as_mainfile(filepath=str(args.out.resolve()), copy=True)
    print(f"Wrote {args.out}")


if __name__ == "__main__":
    main()
    sys.stdout.flush()
    # Blender before 5.0 can crash at exit.
    os._exit(0)
