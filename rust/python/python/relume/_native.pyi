"""Lengths are metres, colours scene-linear, angles radians. Every method raises ValueError for bad input and names
the object; work runs without the GIL."""

import os
from collections.abc import Sequence
from typing import Any, Literal, TypedDict

import numpy as np
from numpy.typing import NDArray

__version__: str

Matrix3 = Sequence[Sequence[float]]
Matrix4 = Sequence[Sequence[float]]

class RelumeError(RuntimeError):
    """Failure, with the next step."""

class SceneBuilder:
    """Collects a scene; parts are referred to by the numbers that the add_ methods return."""

    def __init__(self, working_space: str = "Linear Rec.709") -> None: ...
    def add_mesh(
        self,
        name: str,
        positions: NDArray[np.float32],
        corner_verts: NDArray[np.int32],
        face_starts: NDArray[np.int32],
        *,
        vertex_normals: NDArray[np.float32] | None = None,
        corner_normals: NDArray[np.float32] | None = None,
        sharp_faces: NDArray[np.bool_] | None = None,
        uv_maps: dict[str, NDArray[np.float32]] | None = None,
        color_attributes: dict[str, NDArray[np.float32]] | None = None,
        material_slots: NDArray[np.int32] | None = None,
        texture_space: list[list[float]] | None = None,
        displacement_normals: NDArray[np.float32] | None = None,
        turns_corner_normals: bool = False,
        shown_by: str | None = None,
        motion: NDArray[np.float32] | None = None,
        dicing: tuple[str, NDArray[np.int32], NDArray[np.float32], NDArray[np.float32]] | None = None,
    ) -> int:
        """A polygon mesh in object space: positions [V, 3], vertex of each corner [C], first corner of each face
        [F], normals [V, 3] or [C, 3] (flat without), UV maps [C, 2] and linear colours [C, 4] with
        the render one first, slots [F]. The texture space is the centre and half size of the box of generated
        coordinates, that of the positions without. Normals of displacement [V, 3] are given where a material
        displaces the mesh: those of corners are replaced, or turned as far as the vertices' turn. What is not
        finite is left out or replaced, and named in a warning by the object that shows the mesh, if one is told.
        Motion [M, V, 3] holds the positions at keys that are equally spaced over the shutter's interval: three, five,
        or another number one above a power of two.
        Dicing makes it the cage of a surface that is cut into small triangles (adaptive subdivision). It holds JSON:
        the length of `edge`s, in pixels where there is a `screen`; how often faces are halved (`levels`); borders of
        the `smooth` surface and of its UV maps. Then come vertices [E, 2] and sharpness [E] of creases, and sharpness
        [V] of vertices, or none. A scene gets 16 million such triangles; a warning tells of edges that are longer for
        that."""

    def add_curves(
        self,
        name: str,
        keys: NDArray[np.float32],
        radii: NDArray[np.float32],
        first_keys: NDArray[np.int32],
        *,
        shape: str = "ribbon",
        subdivisions: int = 2,
        first_number: int = 0,
        uv_maps: dict[str, NDArray[np.float32]] | None = None,
        key_attributes: dict[str, NDArray[np.float32]] | None = None,
        curve_attributes: dict[str, NDArray[np.float32]] | None = None,
        generated: NDArray[np.float32] | None = None,
        normals: NDArray[np.float32] | None = None,
        motion: NDArray[np.float32] | None = None,
    ) -> int:
        """Hair curves in object space: keys [K, 3] and radii [K] in metres, first key of each curve and the number of
        keys [C + 1]; shape `ribbon` (of `2 ** subdivisions` pieces a span), `round` or `linear`; UV maps [C, 2] and
        linear colours [K, 4] or [C, 4] by name, generated coordinates [C, 3], normals [K, 3]. Random
        numbers of curves go on from `first_number`. Motion [M, K, 4] holds keys and radii as for meshes."""

    def add_points(
        self,
        name: str,
        positions: NDArray[np.float32],
        radii: NDArray[np.float32],
        *,
        uv_maps: dict[str, NDArray[np.float32]] | None = None,
        attributes: dict[str, NDArray[np.float32]] | None = None,
        motion: NDArray[np.float32] | None = None,
    ) -> int:
        """Spheres in object space: centres [N, 3] and radii [N] in metres, UV maps [N, 2] and linear colours [N, 4].
        Motion [M, N, 4] holds centres and radii as for meshes."""

    def add_instance(
        self,
        name: str,
        geometry: int,
        world_from_object: Matrix4,
        materials: Sequence[int],
        *,
        kind: str = "mesh",
        receiver: int = 0,
        color: Sequence[float] = (1.0, 1.0, 1.0, 1.0),
        pass_index: int = 0,
        random: float = 0.0,
        shadow_terminator_offset: float = 0.1,
        shadow_terminator_shading: float = 0.0,
        visibility: Sequence[bool] = (True, True, True, True),
        visible_volume_scatter: bool = True,
        visible_shadow: bool = True,
        visible_raycast: bool = True,
        is_holdout: bool = False,
        is_shadow_catcher: bool = False,
        links: tuple[list[int] | None, list[int] | None] | None = None,
        occlusion_distance: float = 0.0,
        density_factor: float = 1.0,
        grids: int | None = None,
        attributes: Sequence[tuple[str, Sequence[float]]] = (),
        motion: Sequence[Matrix4] = (),
    ) -> None:
        """Places a mesh, or what `kind` says: `curves` or `points`; matrices are rows, one material a slot,
        visibility to camera, diffuse, glossy and transmission rays. The density of a medium inside is multiplied by a
        factor; `grids` are those of a volume; `attributes` are four numbers each, where the geometry has none. Motion
        holds the matrix at keys, as for meshes."""

    def add_grid_file(
        self,
        name: str,
        path: str | os.PathLike[str],
        wanted: Sequence[str],
        *,
        clipping: float = 0.0,
        interpolation: Literal["linear", "cubic"] = "linear",
        shift: float = 0.0,
        velocities: tuple[Sequence[str], float, float] | None = None,
    ) -> tuple[int, int] | None:
        """Numbers of the wanted grids of an OpenVDB file, and of the mesh of a box around all that their active voxels
        have a part in; None if no voxel is active. Scalars that are not above `clipping` become background.
        `velocities` names grids by which all values move, one or three for the axes, with the way for a velocity of 1
        while the shutter is open from 0 to 1, and the time at which values are where the grids have them.
        Values lie at the whole numbers of the file's index space, shifted by voxels. Grids that cannot be read are
        named in warnings, by the object `name`; ValueError says what is wrong with the file."""

    def add_grid_arrays(
        self,
        name: str,
        grids: dict[str, NDArray[np.float32]],
        low: Sequence[float],
        high: Sequence[float],
        *,
        clipping: float = 0.0,
        interpolation: Literal["linear", "cubic"] = "linear",
    ) -> tuple[int, int] | None:
        """The same of arrays [z, y, x] or [z, y, x, channels]: 3 of a colour, 4 of one that is multiplied by the
        fourth. The voxels of each fill a box of object space."""

    def add_material(self, json: str) -> int:
        """A shader graph in the JSON form of `relume_scene::Material`."""

    def empty(self) -> SceneBuilder:
        """A builder of the same working space without anything."""

    @staticmethod
    def constant_emission(json: str) -> tuple[list[float] | None, int | None]:
        """Emission of such a graph as a lamp's, if it is the same everywhere; else the number of a node that varies."""

    def emission_map(self, material: int, lamp: str) -> tuple[tuple[float, str] | None, list[str]]:
        """Emission of a shader graph by direction, of a lamp in the JSON form of `relume_trace::shading::Lamp`: the
        largest value, and the JSON form of `relume_scene::EmissionMap`; None if it emits nothing. Then what is to be
        said of it."""

    def add_texture(
        self,
        name: str,
        texels: NDArray[np.uint8] | NDArray[np.float32],
        *,
        encoding: Literal["srgb", "linear"] = "srgb",
        alpha: Literal["straight", "premultiplied", "channel_packed", "none"] = "straight",
        size: tuple[int | None, float] | None = None,
    ) -> int:
        """RGBA texels [height, width, 4], bottom row first. `size`: most texels along a side, and the largest share of
        them; sides are halved until both hold."""

    def add_texture_file(
        self,
        name: str,
        file: str | os.PathLike[str] | bytes,
        *,
        colors: Literal["srgb", "linear", "data"] = "srgb",
        alpha: Literal["straight", "premultiplied", "channel_packed", "none"] = "straight",
        scene_from_rec709: Matrix3 | None = None,
        size: tuple[int | None, float] | None = None,
    ) -> int | None:
        """The texels that Blender has of a picture file, or of its bytes: PNG, JPEG, OpenEXR, TIFF or Radiance; None if
        it is none that can be read. `colors`: what its values stand for. `scene_from_rec709`: into the scene's linear
        space, where that is another. `size` is that of `add_texture`."""

    def set_camera(self, json: str) -> None:
        """A Blender camera in the JSON form of `relume_scene::BlenderCamera`."""

    def set_world(
        self,
        color: Sequence[float],
        *,
        texture: int | None = None,
        texture_from_world: Matrix3 = ...,
        visible_camera: bool = True,
        parts: Sequence[tuple[Sequence[bool], Sequence[float], int | None, Matrix3]] = (),
        volume: int | None = None,
        receiver: int = 0,
    ) -> None:
        """Background radiance, or factor on an equirectangular texture. `parts` have the kinds of rays that see them in
        its place (camera, diffuse, glossy, transmitted, scattered in media), colour, texture and matrix. `volume` is a
        material whose volume fills all space, as an object of a receiver number."""

    def add_light(self, json: str) -> None:
        """A Blender light in the JSON form of `relume_scene::BlenderLight`."""

    def warn(self, message: str) -> None:
        """Keeps a message for the user, once."""

    def build_world(self, texture_of: World | None = None) -> World:
        """Its world alone, which needs no camera; the builder is empty afterwards. With the texture of another world
        from `build_world`, if one is given, in place of its own: nothing of that is read again."""

    def build(self) -> Scene:
        """The finished scene; the builder is empty afterwards."""

class World:
    """A world apart from any scene, to be shown along the paths of a bake."""

    @property
    def warnings(self) -> list[str]: ...
    @property
    def map(self) -> str:
        """Map of the world, like `Scene.world_map`."""

    @property
    def color(self) -> list[float]:
        """Radiance of the world, or the factor on its texture; RGB."""

class Scene:
    """A finished scene."""

    @property
    def warnings(self) -> list[str]: ...
    @property
    def working_space(self) -> str: ...
    @property
    def resolution(self) -> tuple[int, int]:
        """Width and height in pixels."""

    @property
    def world_color(self) -> list[float]:
        """Radiance of the world, or the factor on its texture; RGB."""

    @property
    def world_map(self) -> str:
        """Hash of the world's texture, how it is turned, channels in which it is black, and whether the camera sees it;
        strength and tint do not count."""

    @property
    def hash(self) -> str:
        """Hash of all that decides the paths, as a bake's `manifest.json` carries it; lights and world do not count."""

    def seen_by(self, camera: str) -> Scene:
        """The same scene through another camera, in the form of `SceneBuilder.set_camera`."""

    def difference(self, folder: str | os.PathLike[str], settings: str = "{}") -> str | None:
        """Difference of the bake in a folder from this scene and these settings; samples do not count, nor
        another world where all samples of the settings are there: it is gathered."""

    def bake(self, folder: str | os.PathLike[str], settings: str = "{}", *, resume: bool = False) -> Job:
        """Traces the paths into a folder; settings in the JSON form of `relume_trace::TraceSettings`."""

    def write(self, file: str | os.PathLike[str], settings: str = "{}", *, view: bytes | None = None) -> None:
        """Writes a scene file, for `relume trace`, with its render settings and the bytes of a bake's `view.png`."""

    def lights(self) -> str:
        """The scene's lights, a light set in JSON."""

    def texels(self, texture: int) -> NDArray[np.uint8] | NDArray[np.float32]:
        """RGBA texels [height, width, 4] of a texture, bottom row first, as rendering sees them."""

    def grid_values(self, grids: int, name: str, positions: NDArray[np.float32]) -> NDArray[np.float32]:
        """Values of a grid at positions in object space [N, 3], as [N, 3]."""

    def summary(self) -> str:
        """Camera, lights, materials and sizes as JSON."""

class DataPasses:
    """Passes of a scene's picture that no light changes, traced along the camera rays of a bake with these settings."""

    def __init__(
        self,
        scene: Scene,
        settings: str = "{}",
        *,
        samples: int = 64,
        ranks: int = 6,
        alpha_threshold: float = 0.5,
        assets: dict[str, str] = ...,
        frames: tuple[Scene, Scene] | None = None,
        relighter: Relighter | None = None,
    ) -> None:
        """Starts the job. Ranks are the objects or materials that a matte tells apart in a pixel, 1 to 16; assets the
        names of those that objects belong to, where they are other ones. Positions and indices are those of the first
        surface whose alpha reaches the threshold. The scene at the frames before and after tells how far that moves. A
        relighter of the scene lends what it has prepared."""

    @property
    def job(self) -> Job: ...
    def pictures(self) -> dict[str, NDArray[np.float32]]:
        """[H, W, C] once the job is done, a single time: position [3] in metres, object_index and material_index [1];
        vector [4], the way in pixels since the frame before and to the one after, with Cycles' signs;
        uv [3], a mean over the samples as the mattes are, its last channel the share that has coordinates; and the
        mattes objects, materials and assets [2 a rank], each rank an identifier and its share of the pixel
        (Cryptomatte)."""

    def names(self) -> tuple[set[str], set[str]]:
        """Names of the objects and materials of the scene."""

class Relighter:
    """An open bake folder, or a folder of proxies."""

    def __init__(
        self,
        folder: str | os.PathLike[str],
        *,
        world_of: Scene | None = None,
        shots: Sequence[Live] = (),
        device: str = "auto",
        gpu_memory: int | None = None,
    ) -> None:
        """Under the world that was shown last of the bake, or that of a scene. Of live shots, the one that has the
        scene of the bake in memory lends it. Device: auto, cpu, gpu or a part of a GPU's name, or where it is plugged
        in (0000:01:00.0). GPU memory to use, bytes; by default what its driver says, less some for others; the last one
        set counts for the process."""

    @property
    def resolution(self) -> tuple[int, int]:
        """Width and height in pixels."""

    @property
    def damaged(self) -> list[str]:
        """Files of the folder that could not be used, and what follows, in words for the user."""

    @property
    def world_color(self) -> list[float] | None:
        """Radiance of the world that is shown, or the factor on its texture, RGB; None of proxies alone."""

    def scene_lights(self) -> str:
        """The lights that the scene came with, a light set in JSON."""

    def rarely_met(self, lights: str | None = None) -> list[str]:
        """Names of those lights (a light set in JSON; the scene's if None) that hardly any path of the bake meets, so
        that their pictures are noise, while paths that look for them would."""

    def relight(
        self,
        lights: str | None = None,
        *,
        static_light: Sequence[float] = (1.0, 1.0, 1.0),
        world: Sequence[float] = (1.0, 1.0, 1.0),
        catcher_apart: bool = False,
        maker: Literal["auto", "gather", "proxy"] = "auto",
        denoise: bool = True,
        lobes: bool = False,
    ) -> dict[str, Any]:
        """Pictures under a light set (JSON; the scene's lights if None): scene-linear arrays [height, width, channels],
        top row first: combined, static, world, albedo, normal, depth, alpha, shadow_catcher where there is one, and
        lights by name. With lobes also those: by light, then by part ("Diffuse Direct"), which add up to the light and
        need a bake. Gains are RGB factors on the scene's own light and on that of the world. Apart, what shadow
        catchers show is not in the combined picture and its alpha."""

    def prepare(
        self,
        lights: str | None = None,
        *,
        maker: Literal["auto", "gather", "proxy"] = "auto",
        denoise: bool = True,
        lobes: bool = False,
    ) -> Job:
        """Makes each light's picture ahead, with progress and cancel; `relight` with the same arguments only sums."""

class Board:
    """Shots that take turns on one device, within one budget of memory. One at a time makes its picture: the shot that
    was attended last comes first, and all get a first picture before any other gets a better one."""

    def __init__(self) -> None: ...

class Live:
    """A shot that is baked, trained and relit in the background. Every method returns at once."""

    def __init__(
        self,
        folder: str | os.PathLike[str],
        *,
        device: str = "auto",
        gpu_memory: int | None = None,
        threads: int = 0,
        board: Board | None = None,
    ) -> None:
        """A shot with its bake in a folder. Nothing is read or written yet. Devices as of `Relighter`; 0 threads for
        one a core. It takes turns with the other shots on a board."""

    def bake(self, scene: Scene, settings: dict[str, Any], *, train_seconds: float = 60.0, anew: bool = False) -> None:
        """Bakes a scene into the folder, with pictures after every pass, then trains a proxy for so many seconds for
        each kind of light in use. Goes on with a bake of the same scene and settings (JSON form of
        `relume_trace::TraceSettings`), replaces one of another, and if asked (`anew`) also a whole one whose paths
        look for other lights than the present ones. Raises RelumeError if that is going on already."""

    def open(self, *, train_seconds: float = 0.0) -> None:
        """Shows what the folder holds, and trains if asked and not trained yet."""

    def learn(self, train_seconds: float) -> None:
        """Trains a proxy for so many seconds for each kind of light in use that has none yet, on the whole bake that is
        shown. Raises RelumeError if something is baked or trained already."""

    def relight(self, request: Request) -> int:
        """Asks for a picture; the newest request wins. Returns its number."""

    def show_world(self, world: World, request: Request) -> int:
        """Asks for a picture under another world from now on, gathered from the same paths, also while they are being
        traced; factors on its light are relative to its colour. It is stored in the folder, unless it is the paths'
        own."""

    def attend(self) -> None:
        """Makes this the shot of its board that somebody looks at."""

    def frame(self, newer_than: int = 0) -> Frame | None:
        """The newest frame, if its serial number is above this."""

    def status(self) -> LiveStatus:
        """State of the shot now."""

    def pause(self, paused: bool) -> None:
        """Lets baking and training stand still, or go on; relighting always goes on."""

    def cancel(self) -> None:
        """Ends baking and training; what is there stays, and relighting goes on."""

    def close(self, *, wait_seconds: float = 0.0) -> None:
        """Ends everything; files stay whole. Waits at most so long for the threads to end."""

class Light:
    """One light of a light set, parsed once. Immutable."""

    def __init__(self, description: dict[str, Any]) -> None:
        """JSON form of `relume_scene::Light` or `BlenderLight`. Raises ValueError that names the light."""

    @property
    def name(self) -> str:
        """Name of the light."""

    @property
    def kind(self) -> str | None:
        """The proxy that can answer for it, as `relume train --type` calls it; None if it is always gathered."""

Color = Sequence[float]
"""RGB."""

class Request:
    """A picture to ask for. Immutable."""

    def __init__(
        self,
        lights: Sequence[Light],
        *,
        gains: dict[str, Color] = ...,
        world: Color = ...,
        static: Color = ...,
        interactive: bool = False,
        half: bool | None = None,
        aov: Literal["albedo", "normal", "depth"] | None = None,
    ) -> None:
        """Lights, factors on them by name, and factors on the light of world and emissive surfaces. `interactive`:
        quick before exact. `half`: an interactive picture of half the size; by default on slow machines. `aov`: a
        picture of that in place of the lights. Raises ValueError that names what is too bright."""

    @staticmethod
    def parse(text: str) -> Request:
        """A request from JSON: a light set `lights`, the other parameters, and `with` (auto, gather, proxy)."""

class StageProgress(TypedDict):
    """Progress of a stage of the work."""

    stage: str
    done: int
    total: int
    elapsed_s: float
    remaining_s: float | None
    message: str

class ProxyQuality(TypedDict):
    """Errors of a proxy on lights that it never saw, and of gathering as many samples."""

    psnr: float
    smape: float
    gather_smape: float

class Shown(TypedDict):
    """Contents of a frame."""

    serial: int
    request: int
    scale: int
    samples: int
    makers: dict[str, str]
    denoised: bool
    settled: bool
    noise: float | None

class LiveStatus:
    """State of a `Live` at one moment. Immutable; equal if all fields are."""

    state: Literal["empty", "preparing", "baking", "training", "ready", "cancelled", "failed"]
    paused: bool
    """True if baking and training stand still."""
    stage: StageProgress | None
    samples: int
    """Paths per pixel so far."""
    samples_total: int
    """Paths per pixel at the end."""
    world_color: list[float] | None
    """Radiance of the world that is shown, or the factor on its texture. None without paths."""
    world_map: str | None
    """Hash of the world that is shown. None without paths."""
    world_is_stored: bool
    """True if whoever opens the folder sees that world."""
    proxies: dict[str, ProxyQuality]
    """Trained proxies by kind of light."""
    unlearned: list[str]
    """Kinds of light in the newest request that have no proxy."""
    to_learn: list[int]
    """Paths per pixel of each training that has not ended."""
    device: str
    """Device that makes the pictures, in words."""
    warnings: list[str]
    rarely_met: list[str]
    """Lights of the newest request that hardly any path meets, while new paths would."""
    error: str | None
    shown: Shown | None
    """Contents of the newest frame."""

    def __init__(self, **fields: Any) -> None:
        """A status with some fields; the others are those of a shot without a bake."""

    def with_picture_of(self, other: LiveStatus) -> LiveStatus:
        """This status with `shown`, `rarely_met` and `warnings` of another."""

class Frame:
    """A finished picture of a `Live`."""

    @property
    def serial(self) -> int:
        """Number of the frame, from 1."""

    @property
    def request(self) -> int:
        """Number of the request that it answers."""

    @property
    def scale(self) -> int:
        """1 for the full size, 2 for half."""

    @property
    def image(self) -> NDArray[np.float32]:
        """Scene-linear RGBA [height, width, 4], bottom row first, premultiplied. The same array at every
        access."""

    @property
    def summary(self) -> str:
        """Description of the frame; the JSON form of `relume_session::live::Shown`."""

class Job:
    """Running work; see `relume.Job`."""

    @property
    def done(self) -> bool: ...
    def cancel(self) -> None: ...
    def progress(self) -> str | None: ...
    def preview(self) -> str | None: ...
    def warnings(self) -> list[str]: ...
    def result(self) -> str: ...

def solve(
    folders: Sequence[str | os.PathLike[str]],
    request: str,
    images: dict[str, NDArray[np.float32]],
    *,
    shots: Sequence[Live] = (),
    device: str = "auto",
    gpu_memory: int | None = None,
    threads: int = 0,
) -> Job:
    """See `relume.solve`."""

def start_command(args: list[str]) -> Job:
    """Starts a command of the command line, without printing."""

def matte_hash(name: str) -> tuple[int, int]:
    """Hash of a name in a Cryptomatte: MurmurHash3, and the bits of the float that stands for it."""

def folder_in_use(folder: str | os.PathLike[str]) -> str | None:
    """Who bakes into a folder, if another process does, and what to do."""

def run_command_line(args: list[str]) -> int:
    """Runs the command line, prints as it goes and returns the exit code."""
