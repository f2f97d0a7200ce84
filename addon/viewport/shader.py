"""The shader of the overlay, written for Blender's `gpu` module; compiled at first use.

It puts a scene-linear frame, or two to compare, into the camera's rectangle of a region, in the colours that the
scene's view shows. In one pass: between two the window's thread would wait.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import gpu
import numpy as np
from gpu_extras.batch import batch_for_shader

from ..export.color_table import LOG_MAX
from ..export.false_color import LEVELS
from ..export.view_transform import SHAPER_MIN, SHAPER_OFFSET

VERTEX = """
void main()
{
  pixel = mix(drawn.xy, drawn.zw, position);
  gl_Position = vec4(pixel / region.xy * 2.0 - 1.0, 0.0, 1.0);
}
"""

KEEP_LOOPS = "#pragma optionNV(unroll none)\n"
"""Directive for NVIDIA's compiler, which is faster with it; others do not know it."""

# Fetches by hand: Python cannot choose a texture's filter before Blender 5.2, and the weights stay exact.
FRAGMENT = (
    f"""
#define SHAPER_MIN {SHAPER_MIN}
#define SHAPER_RANGE {LOG_MAX - SHAPER_MIN}
#define SHAPER_OFFSET {SHAPER_OFFSET}
"""
    + """
#define SPLIT 1
#define DIFFERENCE 2
#define SPLIT_AT region.z
#define OPACITY region.w
#define SCALE numbers.x
#define EXPONENT numbers.y
#define GAIN numbers.z
#define LARGEST_RADIUS 16.0

float finite(float x)
{
  return x > 0.0 ? min(x, 65504.0) : 0.0; /* NaN is not greater. */
}

vec4 texel(bool is_first, ivec2 at)
{
#ifdef COMPARES
  vec4 color = is_first ? texelFetch(first, at, 0) : texelFetch(second, at, 0);
#else
  vec4 color = texelFetch(first, at, 0);
#endif
  return vec4(finite(color.r), finite(color.g), finite(color.b), clamp(color.a, 0.0, 1.0));
}

/* A picture at a place of 0..1. */
vec4 filtered(bool is_first, vec2 at)
{
#ifdef COMPARES
  ivec2 size = is_first ? textureSize(first, 0) : textureSize(second, 0);
#else
  ivec2 size = textureSize(first, 0);
#endif
#ifdef ONE_TO_ONE
  return texel(is_first, clamp(ivec2(floor(at * vec2(size))), ivec2(0), size - 1));
#else
  /* A tent over the texels under the pixel: bilinear when larger, smooth when smaller. */
  vec2 center = at * vec2(size) - 0.5;
  vec2 radius = clamp(vec2(size) / (frame.zw - frame.xy), vec2(1.0), vec2(LARGEST_RADIUS));
  ivec2 low = ivec2(floor(center - radius)) + 1;
  ivec2 high = ivec2(ceil(center + radius)) - 1;
  vec4 sum = vec4(0.0);
  float weights = 0.0;
  for (int y = low.y; y <= high.y; y++) {
    for (int x = low.x; x <= high.x; x++) {
      vec2 near = max(1.0 - abs(vec2(float(x), float(y)) - center) / radius, vec2(0.0));
      float weight = near.x * near.y;
      sum += weight * texel(is_first, clamp(ivec2(x, y), ivec2(0), size - 1));
      weights += weight;
    }
  }
  return sum / weights;
#endif
}

/* Texel of the list `levels` at a place of 0..1. */
int level_of(float place)
{
  return int(clamp(place, 0.0, 1.0) * float(textureSize(levels, 0) - 1) + 0.5);
}

#ifdef HAS_TABLE
vec3 from_table(vec3 color)
{
  int last = textureSize(table, 0).x - 1;
  vec3 at = (log2(color + SHAPER_OFFSET) - SHAPER_MIN) * (float(last) / SHAPER_RANGE);
  at = clamp(at, vec3(0.0), vec3(float(last)));
  ivec3 low = min(ivec3(at), ivec3(last - 1));
  vec3 part = at - vec3(low);
  vec3 sum = vec3(0.0);
  for (int corner = 0; corner < 8; corner++) {
    ivec3 bit = ivec3(corner & 1, (corner >> 1) & 1, corner >> 2);
    vec3 weight = mix(1.0 - part, part, vec3(bit));
    sum += weight.x * weight.y * weight.z * texelFetch(table, low + bit, 0).rgb;
  }
  return sum;
}
#else
float srgb_from_linear(float x)
{
  x = clamp(x, 0.0, 1.0);
  return x <= 0.0031308 ? 12.92 * x : 1.055 * pow(x, 1.0 / 2.4) - 0.055;
}
#endif

/* Display colour, not multiplied by alpha, of a scene-linear one that is. As Blender's own display: light without cover
 * (alpha 0) is shown as it is. */
vec4 displayed(vec4 pixel)
{
  vec3 color = pixel.rgb * (SCALE / (pixel.a > 0.0 ? pixel.a : 1.0));
#ifdef HAS_TABLE
  color = from_table(color);
  if (has_places != 0) {
    color = texelFetch(levels, level_of(color.r), 0).rgb;
  }
#else
  color = vec3(dot(to_red.rgb, color), dot(to_green.rgb, color), dot(to_blue.rgb, color));
  color = vec3(srgb_from_linear(color.r), srgb_from_linear(color.g), srgb_from_linear(color.b));
  color = EXPONENT == 1.0 ? color : pow(color, vec3(EXPONENT));
#endif
  return vec4(color, pixel.a);
}

float overlay_from_display(float color)
{
  return texelFetch(levels, level_of(color), 0).a;
}

void main()
{
  vec2 at = (pixel - frame.xy) / (frame.zw - frame.xy);
  bool right = pixel.x >= SPLIT_AT;
#ifdef COMPARES
  int last = mode == DIFFERENCE ? 1 : 0;
  vec4 color = vec4(0.0);
  for (int turn = 0; turn <= last; turn++) {
    vec4 shown = displayed(filtered(turn == 0 && !(mode == SPLIT && right), at));
    color = turn == 0 ? shown : vec4(min(abs(color.rgb - shown.rgb) * GAIN, vec3(1.0)), 1.0);
  }
#else
  if (right) {
    discard;
  }
  vec4 color = displayed(filtered(true, at));
#endif
  if (color.a * OPACITY < 1.0) {
    color.rgb = pow(color.rgb, vec3(2.2)); /* Blended, so that no level can be chosen. */
  }
  else {
    color.rgb = vec3(overlay_from_display(color.r), overlay_from_display(color.g), overlay_from_display(color.b));
  }
  result = vec4(color.rgb * (color.a > 0.0 ? color.a : 1.0), color.a) * OPACITY;
}
"""
)

ENCODING_ENTRIES = LEVELS
ROWS = ("to_red", "to_green", "to_blue")
"""Rows of `ViewTable.to_rec709`, each with a fourth value that is not read."""


@dataclass(frozen=True)
class Program:
    """A compiled shader and the square of corners 0 and 1 that it is drawn with."""

    shader: Any
    square: Any


@cache
def show(one_to_one: bool, compares: bool, has_table: bool) -> Program:
    """Program that draws pictures. There are several, because a driver compiles all that a program could do.

    With `one_to_one` each pixel is one texel, without any filter. Without `compares` there is one picture, left of the
    split. Samplers are `first` and `levels` (`texture.of_levels`). Constants are `frame` and `drawn`, rectangles in
    pixels of the region; `region`: its width and height, the place of the split, opacity; `numbers`: scale and exponent
    of the view, gain of a difference. With a table there are the sampler `table` and `has_places`: 1 if it holds places
    in `levels`; otherwise `ROWS`. With `compares` there are the sampler `second` and `mode`: SPLIT or DIFFERENCE. All
    in 128 bytes: drivers need not have more."""
    info = gpu.types.GPUShaderCreateInfo()
    info.sampler(0, "FLOAT_2D", "first")
    info.sampler(1, "FLOAT_1D", "levels")
    for name in ("frame", "drawn", "region", "numbers", *(() if has_table else ROWS)):
        info.push_constant("VEC4", name)
    if has_table:
        info.sampler(2, "FLOAT_3D", "table")
        info.push_constant("INT", "has_places")
        info.define("HAS_TABLE")
    if compares:
        info.sampler(3, "FLOAT_2D", "second")
        info.push_constant("INT", "mode")
        info.define("COMPARES")
    between = gpu.types.GPUStageInterfaceInfo("relume_show")
    between.smooth("VEC2", "pixel")
    info.vertex_out(between)
    if one_to_one:
        info.define("ONE_TO_ONE")
    is_opengl = gpu.platform.backend_type_get() == "OPENGL"
    return compile_program(info, VERTEX, KEEP_LOOPS + FRAGMENT if is_opengl else FRAGMENT)


def overlay_encoding() -> np.ndarray:
    """Texture values by which the 3D view's overlay shows a display colour, [entries] for display colours from 0 to 1.

    Blender stores eight bits along the sRGB curve and shows the power 1 / 2.2 of what it reads. The levels are coarse
    in the dark, so of the two around a colour the one that is shown nearest to it is chosen."""
    level = np.arange(256) / 255.0
    linear = np.where(level <= 0.04045, level / 12.92, ((level + 0.055) / 1.055) ** 2.4)
    shown = linear ** (1.0 / 2.2)
    display = np.linspace(0.0, 1.0, ENCODING_ENTRIES)
    return linear[np.searchsorted((shown[1:] + shown[:-1]) / 2.0, display)].astype(np.float32)


def free() -> None:
    """Lets go of the compiled shaders."""
    show.cache_clear()


def compile_program(info: Any, vertex: str, fragment: str) -> Program:
    """A program of one `position` in 0..1 and one `result`."""
    info.vertex_in(0, "VEC2", "position")
    info.fragment_out(0, "VEC4", "result")
    info.vertex_source(vertex)
    info.fragment_source(fragment)
    shader = gpu.shader.create_from_info(info)
    corners = {"position": [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)]}
    return Program(shader, batch_for_shader(shader, "TRI_STRIP", corners))
