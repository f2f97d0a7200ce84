"""Times of the overlay on this machine's graphics, and whether the proxy's head should run there. Needs the Python of
Blender 5.2, whose `gpu` works without a window: .venv-5.2/bin/python scripts/bench/overlay.py

The head in question: fast network, 64 wide, two hidden layers, one light, without its analytic features and sums, which
favours it; its trunk's activations and its weights already lie in textures. Against it stands what running it in
Blender's context would save: the upload of the finished picture. Writes `out/bench-overlay.json`.
"""

import argparse
import json
import sys
import time
from pathlib import Path
from types import SimpleNamespace

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

import bpy  # noqa: E402
import gpu  # noqa: E402
import numpy as np  # noqa: E402

from addon.viewport import overlay, shader, texture, view_table  # noqa: E402
from addon.viewport.camera_frame import Rectangle  # noqa: E402

SIZES = ((960, 540), (480, 270))
REGION = (1500, 900)
REPEATS, HEAD_REPEATS = 15, 3
WIDTH, HIDDEN = 64, 2

HEAD_VERTEX = """
void main()
{
  gl_Position = vec4(position * 2.0 - 1.0, 0.0, 1.0);
}
"""

# Four neurons in each texel; activations and weights are read as they lie, row by row.
HEAD_FRAGMENT = (
    f"""
#define QUADS {WIDTH // 4}
#define HIDDEN {HIDDEN}
"""
    + """
void main()
{
  vec4 now[QUADS];
  vec4 next[QUADS];
  for (int i = 0; i < QUADS; i++) {
    now[i] = max(texelFetch(trunk, ivec3(ivec2(gl_FragCoord.xy), i), 0), 0.0);
  }
  for (int layer = 0; layer < HIDDEN; layer++) {
    for (int row = 0; row < QUADS; row++) {
      vec4 sum = vec4(0.0);
      for (int column = 0; column < QUADS; column++) {
        for (int part = 0; part < 4; part++) {
          int at = (layer * QUADS + row) * 4 + part;
          sum[part] += dot(texelFetch(weights, ivec2(column, at), 0), now[column]);
        }
      }
      next[row] = max(sum, 0.0);
    }
    now = next;
  }
  vec3 color = vec3(0.0);
  for (int column = 0; column < QUADS; column++) {
    for (int part = 0; part < 3; part++) {
      color[part] += dot(texelFetch(weights, ivec2(column, HIDDEN * QUADS * 4 + part), 0), now[column]);
    }
  }
  result = vec4(color, 1.0);
}
"""
)


class Target:
    """A framebuffer to draw into and to wait for."""

    def __init__(self, size, kind):
        self.texture = gpu.types.GPUTexture(size, format=kind)
        self.framebuffer = gpu.types.GPUFrameBuffer(color_slots=self.texture)

    def draw(self, function):
        """Draws, and waits until it is done."""
        with self.framebuffer.bind():
            function()
            self.wait()

    def wait(self):
        """Reads one pixel, which the graphics can only give after all that was asked before."""
        with self.framebuffer.bind():
            self.framebuffer.read_color(0, 0, 1, 1, 4, 0, "FLOAT")


def milliseconds(function, repeats=REPEATS):
    """The quickest of some runs."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        function()
        times.append(1000 * (time.perf_counter() - start))
    return min(times)


def random_texture(size, kind, layers=0, seed=1):
    """Small random numbers on the graphics card."""
    count = 4 * size[0] * size[1] * max(layers, 1)
    values = np.random.default_rng(seed).normal(0.0, 0.15, count).astype(np.float32)
    return gpu.types.GPUTexture(size, layers=layers, format=kind, data=gpu.types.Buffer("FLOAT", count, values))


def head(size):
    """Milliseconds of the head for a whole picture."""
    info = gpu.types.GPUShaderCreateInfo()
    info.sampler(0, "FLOAT_2D_ARRAY", "trunk")
    info.sampler(1, "FLOAT_2D", "weights")
    program = shader.compile_program(info, HEAD_VERTEX, HEAD_FRAGMENT)
    trunk = random_texture(size, "RGBA16F", layers=WIDTH // 4)
    weights = random_texture((WIDTH // 4, WIDTH * HIDDEN + 3), "RGBA16F")
    target = Target(size, "RGBA16F")

    def draw():
        program.shader.bind()
        program.shader.uniform_sampler("trunk", trunk)
        program.shader.uniform_sampler("weights", weights)
        program.square.draw(program.shader)

    return milliseconds(lambda: target.draw(draw), HEAD_REPEATS)


def picture_times(size, view):
    """Milliseconds of the upload of a new picture, and of showing it at the first size."""
    image = np.exp2(np.random.default_rng(1).uniform(-8.0, 4.0, (size[1], size[0], 4))).astype(np.float32)
    image[..., 3] = 1.0
    frame, target = SimpleNamespace(image=image), Target(REGION, "SRGB8_A8")
    rectangle = Rectangle(20, 20, 20 + SIZES[0][0], 20 + SIZES[0][1])
    what = overlay.Show(REGION, rectangle, rectangle, frame, frame)

    def upload():
        texture.keep_only(())
        texture.of_frame(frame)

    shown = milliseconds(lambda: target.draw(lambda: overlay.draw(what, view)))
    return {"upload": milliseconds(upload), f"show at {SIZES[0][0]} x {SIZES[0][1]}": shown}


def main():
    """See the first lines of this file."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=ROOT / "out")
    options = parser.parse_args()
    gpu.init()
    scene = bpy.context.scene
    scene.view_settings.view_transform = "AgX"
    machine = f"{gpu.platform.renderer_get()}, {gpu.platform.backend_type_get()}"
    view, figures = view_table.complete(scene), {}
    for size in SIZES:
        name = f"{size[0]} x {size[1]}"
        figures |= {f"{step}, {name}": value for step, value in picture_times(size, view).items()}
        figures[f"head {WIDTH}x{HIDDEN} in Blender's context, one light, {name}"] = head(size)
    records = [{"name": name, "value": round(value, 3), "unit": "ms", "goal": None} for name, value in figures.items()]
    for record in records:
        print(f"{record['name']:60} {record['value']:9.2f} ms")
    print(machine)
    options.out.mkdir(parents=True, exist_ok=True)
    (options.out / "bench-overlay.json").write_text(json.dumps({"machine": machine, "records": records}, indent=1))


if __name__ == "__main__":
    main()
