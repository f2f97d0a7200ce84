"""Lights of a look as UsdLux (`writing`), and back (`reading`), through text (`text`) alone.

UsdLux and Blender mean the same by normalised lights: with power P, `intensity` is P / pi for points, spots and areas,
and the strength itself for suns. Lights are written normalised. What UsdLux has no word for, such as the spread
of an area, stands in attributes `relume:...`, which other programs pass on.

Blender's own exporter and importer take a sun for a quarter of its strength and half of its angle; files for them say
so, and files that Blender wrote are read so."""
