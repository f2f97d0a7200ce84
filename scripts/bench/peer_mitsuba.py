"""Paths per second of Mitsuba 3 (`llvm_ad_rgb`, its `path` integrator): one JSON line on standard output.

Two renders of the same scene at different sample counts; the slope leaves out loading and kernel compilation.
"""

import argparse
import json
import time

import mitsuba as mi


def render_seconds(scene, spp, seed):
    """Wall seconds of one render with all pixels evaluated."""
    start = time.perf_counter()
    mi.render(scene, spp=spp, seed=seed).numpy()
    return time.perf_counter() - start


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scene", help="scene.xml with the parameters resx, resy, spp and max_depth")
    parser.add_argument("--width", type=int, required=True)
    parser.add_argument("--height", type=int, required=True)
    parser.add_argument("--samples", type=int, required=True)
    parser.add_argument("--bounces", type=int, required=True)
    args = parser.parse_args()

    mi.set_variant("llvm_ad_rgb")
    # Mitsuba counts the segments up to the light: Blender's bounces + camera segment + light segment.
    depth = args.bounces + 2
    scene = mi.load_file(args.scene, resx=args.width, resy=args.height, spp=args.samples, max_depth=depth)
    few, many = max(args.samples // 4, 1), args.samples
    for spp in (few, many):  # compiles the kernels of both sizes
        render_seconds(scene, spp, seed=0)
    seconds = render_seconds(scene, many, seed=2) - render_seconds(scene, few, seed=1)
    paths = args.width * args.height * (many - few)
    print(json.dumps({"peer": f"Mitsuba {mi.__version__} llvm_ad_rgb", "paths_per_second": paths / seconds}))


if __name__ == "__main__":
    main()
