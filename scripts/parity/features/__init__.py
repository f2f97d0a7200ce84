"""Scenes of one feature each, made by script: what `make parity` compares beside the real scenes. Need `bpy`.

Each builder fills an empty scene that `stage.set_up` has made: a floor, a wall and a camera that looks at the origin.
"""

from . import displacement, fast_gi, film, hair, images, lamps, media, motion, rays, skin, surfaces

SCENES = {
    **media.SCENES,
    **skin.SCENES,
    **hair.SCENES,
    **rays.SCENES,
    **displacement.SCENES,
    **images.SCENES,
    **lamps.SCENES,
    **motion.SCENES,
    **film.SCENES,
    **fast_gi.SCENES,
    **surfaces.SCENES,
}
"""Builders by the names of their scenes."""
