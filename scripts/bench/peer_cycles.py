"""Paths per second of Cycles on the CPU, in a Python that has `bpy`: one JSON line on standard output.

Two renders of the same file at different sample counts; the slope leaves out scene synchronisation and BVH build.
"""

import argparse
import json
import time

import bpy


def render_seconds(scene, samples):
    """Wall seconds of one render."""
    scene.cycles.samples = samples
    start = time.perf_counter()
    bpy.ops.render.render()
    return time.perf_counter() - start


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("blend")
    parser.add_argument("--width", type=int, required=True)
    parser.add_argument("--height", type=int, required=True)
    parser.add_argument("--samples", type=int, required=True)
    parser.add_argument("--bounces", type=int, required=True)
    parser.add_argument("--threads", type=int, default=0, help="0: all")
    args = parser.parse_args()

    bpy.ops.wm.open_mainfile(filepath=args.blend)
    bpy.ops.preferences.addon_enable(module="cycles")
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.render.resolution_x, scene.render.resolution_y = args.width, args.height
    scene.render.resolution_percentage = 100
    scene.render.threads_mode = "FIXED" if args.threads else "AUTO"
    if args.threads:
        scene.render.threads = args.threads
    cycles = scene.cycles
    cycles.device = "CPU"
    cycles.use_denoising = False
    cycles.use_adaptive_sampling = False
    cycles.max_bounces = args.bounces
    cycles.diffuse_bounces = cycles.glossy_bounces = cycles.transmission_bounces = args.bounces

    few, many = max(args.samples // 4, 1), args.samples
    render_seconds(scene, few)
    seconds = render_seconds(scene, many) - render_seconds(scene, few)
    paths = args.width * args.height * (many - few)
    print(json.dumps({"peer": f"Cycles {bpy.app.version_string}", "paths_per_second": paths / seconds}), flush=True)


if __name__ == "__main__":
    main()
