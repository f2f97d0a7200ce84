use std::collections::HashMap;
use std::fs::File;
use std::ops::Range;
use std::path::{Path, PathBuf};

use glam::Vec3;
use memmap2::Mmap;
use safetensors::SafeTensors;
use safetensors::tensor::{Dtype, TensorView, serialize};
use serde::{Deserialize, Serialize};

use crate::packing::{self, Flags, Grid};
use crate::records::{bounds, check_samples, pack};
use crate::samples::{AOV_CHANNELS, TileSamples};
use crate::{DumpError, End, Manifest, Pass, TileRect};

/// Key of the shard's description in the `safetensors` metadata.
const HEADER_KEY: &str = "relume_dump";
const TENSORS: [(&str, Dtype); 5] = [
    ("aov", Dtype::F32),
    ("pixel_offsets", Dtype::U32),
    ("position_xy", Dtype::U32),
    ("position_z_flags", Dtype::U32),
    ("throughput", Dtype::U32),
];

/// Header of a shard.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ShardHeader {
    /// [`crate::FORMAT_VERSION`].
    pub format_version: u32,
    /// [`Manifest::bake_id`] of the dump that it belongs to.
    pub bake_id: String,
    /// Pixels.
    pub rect: TileRect,
    /// Samples.
    pub pass: Pass,
    /// Lower corner of the position grid, metres.
    pub bounds_min: [f32; 3],
    /// Upper corner of the position grid, metres.
    pub bounds_max: [f32; 3],
    /// Start of paths without an origin record.
    pub camera_position: Option<[f32; 3]>,
    /// BLAKE3 of this header (with an empty checksum) and of all tensors, hex.
    pub checksum: String,
}

/// The samples of one tile and one pass, packed: a mapped file, or the same bytes in memory.
#[derive(Debug)]
pub struct Shard {
    path: PathBuf,
    header: ShardHeader,
    grid: Grid,
    bytes: Bytes,
    /// Position of each of [`TENSORS`] in `bytes`.
    ranges: [Range<usize>; TENSORS.len()],
}

#[derive(Debug)]
enum Bytes {
    Mapped(Mmap),
    /// Eight-byte words, so that tensors are aligned as in a mapping; the length is in bytes.
    Owned(Vec<u64>, usize),
}

impl Bytes {
    fn as_slice(&self) -> &[u8] {
        match self {
            Self::Mapped(map) => map,
            Self::Owned(words, length) => &bytemuck::cast_slice(words)[..*length],
        }
    }

    fn copy(bytes: &[u8]) -> Self {
        let mut words = vec![0u64; bytes.len().div_ceil(8)];
        bytemuck::cast_slice_mut(&mut words)[..bytes.len()].copy_from_slice(bytes);
        Self::Owned(words, bytes.len())
    }
}

/// One record, decoded.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DecodedSegment {
    /// Start of the segment, world space, metres; of the ray that it continues, see [`Shard::ray_origin`].
    pub origin: Vec3,
    /// End of the segment.
    pub end: End,
    /// RGB weight of what is emitted towards the origin along it.
    pub throughput: Vec3,
    /// Flags: lobe, receiver, what it starts from.
    pub flags: Flags,
    /// Number of the path within the pixel and pass.
    pub path: u32,
}

impl Shard {
    /// Packs samples; the result is what a file of this shard holds. Deterministic.
    ///
    /// # Errors
    /// If the samples do not fit the manifest (tile, pixel and path counts), are too many, or are not finite.
    pub fn encode(
        manifest: &Manifest,
        tile: usize,
        pass: usize,
        samples: &TileSamples,
    ) -> Result<Self, DumpError> {
        let fail = |reason: String| DumpError::Samples { tile, pass, reason };
        if tile >= manifest.tile_count() || pass >= manifest.passes.len() {
            return Err(fail("the manifest has no such tile or pass".into()));
        }
        check_samples(manifest, tile, pass, samples).map_err(fail)?;
        let grid = bounds(&samples.records);
        let count = samples.records.len();
        let [mut xy, mut z_flags, mut throughput] = [(); 3].map(|()| Vec::with_capacity(count));
        let dither_seed = (tile as u32).wrapping_mul(0x9e37_79b9) ^ manifest.passes[pass].first_sample;
        for (index, record) in samples.records.iter().enumerate() {
            let packed = pack(record, &grid);
            xy.push(packed[0]);
            z_flags.push(packed[1]);
            let dither = packing::dither(dither_seed, index as u32);
            throughput.push(packing::encode_rgb9e5(record.throughput, dither));
        }
        let offsets: Vec<u32> =
            samples.pixel_starts.iter().chain([&count]).map(|&offset| offset as u32).collect();
        let header = ShardHeader {
            format_version: manifest.format_version,
            bake_id: manifest.bake_id(),
            rect: samples.rect(),
            pass: manifest.passes[pass],
            bounds_min: grid.min.to_array(),
            bounds_max: grid.max.to_array(),
            camera_position: manifest.camera_position,
            checksum: String::new(),
        };
        let tensors: [&[u8]; TENSORS.len()] = [
            bytemuck::cast_slice(&samples.aov),
            bytemuck::cast_slice(&offsets),
            bytemuck::cast_slice(&xy),
            bytemuck::cast_slice(&z_flags),
            bytemuck::cast_slice(&throughput),
        ];
        let bytes = serialize_shard(header, &tensors, samples.rect().pixel_count(), count).map_err(fail)?;
        Self::parse(PathBuf::from(format!("tile {tile}, pass {pass} in memory")), Bytes::copy(&bytes))
    }

    /// Maps a file and checks its structure (names, sizes, offsets, bounds), not its content; see
    /// [`Shard::problems`].
    pub fn open(path: &Path) -> Result<Self, DumpError> {
        let file = File::open(path).map_err(DumpError::io("open", path))?;
        // Nothing can be mapped of an empty file, which a power failure may leave.
        if file.metadata().map_err(DumpError::io("read", path))?.len() == 0 {
            return Err(DumpError::damaged(path, "the file is empty"));
        }
        // SAFETY: a mapping is only sound while nobody changes the file. Relume writes shards to a temporary name
        // and renames them, never in place; whoever truncates one while it is mapped ends this process with SIGBUS.
        let map = unsafe { Mmap::map(&file) }.map_err(DumpError::io("map", path))?;
        Self::parse(path.to_owned(), Bytes::Mapped(map))
    }

    /// Reads a shard from bytes that nobody vouches for; `name` stands in messages. Never panics.
    pub fn from_bytes(name: &Path, bytes: &[u8]) -> Result<Self, DumpError> {
        Self::parse(name.to_owned(), Bytes::copy(bytes))
    }

    /// Bytes of a file of this shard.
    pub fn as_bytes(&self) -> &[u8] {
        self.bytes.as_slice()
    }

    fn parse(path: PathBuf, bytes: Bytes) -> Result<Self, DumpError> {
        let (header, ranges) =
            parse_structure(bytes.as_slice()).map_err(|reason| DumpError::damaged(&path, reason))?;
        let grid = Grid { min: header.bounds_min.into(), max: header.bounds_max.into() };
        let shard = Self { path, header, grid, bytes, ranges };
        shard.check_structure().map_err(|reason| DumpError::damaged(&shard.path, reason))?;
        Ok(shard)
    }

    /// Checks the offsets that the gather and [`Shard::pixel`] rely on not to read out of bounds.
    fn check_structure(&self) -> Result<(), String> {
        let (header, pixels, records) = (&self.header, self.header.rect.pixel_count(), self.record_count());
        if header.format_version != crate::FORMAT_VERSION {
            return Err(format!("format version {}", header.format_version));
        }
        if self.aov_values().len() != pixels * AOV_CHANNELS || self.pixel_offsets().len() != pixels + 1 {
            return Err(format!("the tensors do not have {pixels} pixels"));
        }
        if self.position_z_flags().len() != records || self.throughput().len() != records {
            return Err("the record tensors differ in length".into());
        }
        let offsets = self.pixel_offsets();
        if offsets[0] != 0 || offsets[pixels] as usize != records || !offsets.is_sorted() {
            return Err(format!("the pixel offsets do not rise from 0 to {records}"));
        }
        let camera = header.camera_position.map_or(Vec3::ZERO, Vec3::from);
        if !(self.grid.min.is_finite() && self.grid.max.is_finite() && camera.is_finite()) {
            return Err("the bounds or the camera position are not finite".into());
        }
        if !(self.grid.max - self.grid.min).is_finite() || self.grid.min.cmpgt(self.grid.max).any() {
            return Err("the lower bound is above the upper".into());
        }
        Ok(())
    }

    /// File, or a description for shards in memory.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Header of the shard.
    pub fn header(&self) -> &ShardHeader {
        &self.header
    }

    /// Pixels.
    pub fn rect(&self) -> TileRect {
        self.header.rect
    }

    /// Samples per pixel.
    pub fn samples(&self) -> u32 {
        self.header.pass.samples
    }

    /// Map from grid coordinates to world space.
    pub fn grid(&self) -> Grid {
        self.grid
    }

    /// Start of paths without an origin record; the world origin if there is none.
    pub fn camera_position(&self) -> Vec3 {
        self.header.camera_position.map_or(Vec3::ZERO, Vec3::from)
    }

    /// Number of records.
    pub fn record_count(&self) -> usize {
        self.position_xy().len()
    }

    /// `[P + 1]`: first record of each pixel, then the number of records.
    pub fn pixel_offsets(&self) -> &[u32] {
        self.tensor(1)
    }

    /// `[N]`: grid x in the low half and y in the high half, or the octahedral direction of an escaped segment.
    pub fn position_xy(&self) -> &[u32] {
        self.tensor(2)
    }

    /// `[N]`: grid z in the low half, [`Flags`] in the high half.
    pub fn position_z_flags(&self) -> &[u32] {
        self.tensor(3)
    }

    /// `[N]`: rgb9e5.
    pub fn throughput(&self) -> &[u32] {
        self.tensor(4)
    }

    /// `[P][16]`: sums over the samples of this pass, see [`crate::aov_channel`].
    pub fn aov(&self) -> &[[f32; AOV_CHANNELS]] {
        self.aov_values().as_chunks().0
    }

    fn aov_values(&self) -> &[f32] {
        bytemuck::cast_slice(&self.as_bytes()[self.ranges[0].clone()])
    }

    fn tensor(&self, index: usize) -> &[u32] {
        bytemuck::cast_slice(&self.as_bytes()[self.ranges[index].clone()])
    }

    /// Records of one pixel, counted row by row within the tile.
    pub fn pixel(&self, pixel: usize) -> Range<usize> {
        let offsets = self.pixel_offsets();
        offsets[pixel] as usize..offsets[pixel + 1] as usize
    }

    /// The segments of one pixel, decoded one by one: clear, not fast.
    pub fn segments(&self, pixel: usize) -> impl Iterator<Item = DecodedSegment> + '_ {
        let mut paths = 0u32;
        self.pixel(pixel).filter_map(move |record| {
            paths += u32::from(self.decode(record).1.path_start());
            let segment = self.segment(record)?;
            Some(DecodedSegment { path: paths.saturating_sub(1), ..segment })
        })
    }

    /// The segment of a record, with `path` 0; `None` for origin records.
    pub fn segment(&self, record: usize) -> Option<DecodedSegment> {
        let (end, flags) = self.decode(record);
        flags.lobe()?;
        let throughput = packing::decode_rgb9e5(self.throughput()[record]);
        Some(DecodedSegment { origin: self.start(record), end, throughput, flags, path: 0 })
    }

    /// Start of the ray that the segment of a record lies on: that of the first of the segments that it continues, or
    /// its own.
    pub fn ray_origin(&self, record: usize) -> Vec3 {
        let continues = |&record: &usize| self.decode(record).1.continues();
        let first = (1..=record).rev().find(|record| !continues(record));
        self.start(first.unwrap_or(0))
    }

    fn start(&self, record: usize) -> Vec3 {
        let before = (!self.decode(record).1.path_start() && record > 0).then(|| self.decode(record - 1).0);
        match before {
            Some(End::Vertex(vertex)) => vertex,
            // Only in a damaged shard does a path go on after it has escaped.
            Some(End::Escape(_)) | None => self.camera_position(),
        }
    }

    fn decode(&self, record: usize) -> (End, Flags) {
        let (xy, z_flags) = (self.position_xy()[record], self.position_z_flags()[record]);
        let flags = Flags((z_flags >> 16) as u16);
        if flags.escaped() {
            return (End::Escape(packing::decode_direction(xy)), flags);
        }
        (End::Vertex(self.grid.decode([xy as u16, (xy >> 16) as u16, z_flags as u16])), flags)
    }

    /// Everything that is wrong with the content, in words; reads the whole shard. `receivers` is the number of
    /// receivers in the manifest.
    pub fn problems(&self, receivers: usize) -> Vec<String> {
        let mut problems = Vec::new();
        let tensors = [0, 1, 2, 3, 4].map(|index| &self.as_bytes()[self.ranges[index].clone()]);
        if checksum(&self.header, &tensors) != self.header.checksum {
            problems.push("the content does not match its checksum".into());
        }
        let unsound = self.aov().iter().filter(|sums| !sums.iter().all(|v| v.is_finite())).count();
        if unsound > 0 {
            problems.push(format!("{unsound} pixels have AOVs that are not finite"));
        }
        let faults: Vec<_> =
            (0..self.rect().pixel_count()).filter_map(|pixel| self.pixel_fault(pixel, receivers)).collect();
        if let Some(first) = faults.first() {
            problems.push(format!("{} pixels have faulty records: {first}", faults.len()));
        }
        problems
    }

    fn pixel_fault(&self, pixel: usize, receivers: usize) -> Option<String> {
        let mut paths = 0;
        let mut path_ended = true;
        let mut in_ray = false;
        for record in self.pixel(pixel) {
            let flags = self.decode(record).1;
            let illegal = |what: &str| Some(format!("record {record} of pixel {pixel} {what}"));
            if flags.is_origin()
                && (flags.escaped() || packing::decode_rgb9e5(self.throughput()[record]) != Vec3::ZERO)
            {
                return illegal("is an origin with a throughput or a direction");
            }
            if path_ended && !flags.path_start() {
                return illegal("continues a path that has ended");
            }
            if flags.continues() && !in_ray {
                return illegal("continues no ray");
            }
            if receivers > 0 && usize::from(flags.receiver()) >= receivers {
                return illegal("has an unknown receiver");
            }
            paths += u32::from(flags.path_start());
            path_ended = flags.escaped();
            in_ray = !flags.is_origin() && !path_ended;
        }
        (paths != self.samples()).then(|| format!("pixel {pixel} has {paths} paths, not {}", self.samples()))
    }
}

fn checksum(header: &ShardHeader, tensors: &[&[u8]; TENSORS.len()]) -> String {
    let unsigned = ShardHeader { checksum: String::new(), ..header.clone() };
    let mut hasher = blake3::Hasher::new();
    hasher.update(&serde_json::to_vec(&unsigned).expect("plain data with string keys"));
    for tensor in tensors {
        hasher.update(tensor);
    }
    hasher.finalize().to_hex().to_string()
}

fn serialize_shard(
    mut header: ShardHeader,
    tensors: &[&[u8]; TENSORS.len()],
    pixels: usize,
    records: usize,
) -> Result<Vec<u8>, String> {
    header.checksum = checksum(&header, tensors);
    let json = serde_json::to_string(&header).expect("plain data with string keys");
    let shapes = [vec![pixels, AOV_CHANNELS], vec![pixels + 1], vec![records], vec![records], vec![records]];
    let mut views = Vec::new();
    for ((&(name, dtype), shape), data) in TENSORS.iter().zip(shapes).zip(tensors) {
        views.push((name, TensorView::new(dtype, shape, data).map_err(|error| error.to_string())?));
    }
    serialize(views, Some(HashMap::from([(HEADER_KEY.to_owned(), json)]))).map_err(|error| error.to_string())
}

/// Header and tensor ranges of untrusted bytes.
fn parse_structure(bytes: &[u8]) -> Result<(ShardHeader, [Range<usize>; TENSORS.len()]), String> {
    let (_, metadata) = SafeTensors::read_metadata(bytes).map_err(|error| error.to_string())?;
    let json = metadata.metadata().as_ref().and_then(|entries| entries.get(HEADER_KEY));
    let json = json.ok_or("not a shard of a Relume dump")?;
    let header: ShardHeader = serde_json::from_str(json).map_err(|error| error.to_string())?;
    const SIZE_LIMIT: usize = 1 << 16;
    let TileRect { x, y, width, height } = header.rect;
    if width == 0 || height == 0 || [x, y, width, height].iter().any(|&size| size > SIZE_LIMIT) {
        return Err("impossible tile".into());
    }
    let file = SafeTensors::deserialize(bytes).map_err(|error| error.to_string())?;
    if file.len() != TENSORS.len() {
        return Err(format!("{} tensors instead of {}", file.len(), TENSORS.len()));
    }
    let mut ranges = [(); TENSORS.len()].map(|()| 0..0);
    for (range, (name, dtype)) in ranges.iter_mut().zip(TENSORS) {
        let tensor = file.tensor(name).map_err(|error| error.to_string())?;
        let rank = if name == "aov" { 2 } else { 1 };
        if tensor.dtype() != dtype || tensor.shape().len() != rank {
            return Err(format!("tensor {name} has another type or shape"));
        }
        let start = tensor.data().as_ptr() as usize - bytes.as_ptr() as usize;
        if !(bytes.as_ptr() as usize + start).is_multiple_of(align_of::<u32>()) {
            return Err(format!("tensor {name} is not aligned"));
        }
        *range = start..start + tensor.data().len();
    }
    Ok((header, ranges))
}
