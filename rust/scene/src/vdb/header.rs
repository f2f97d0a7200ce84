use super::input::Input;
use glam::{Affine3A, DAffine3, DMat3, DVec3};

const MAGIC: i64 = 0x5644_4220;
/// File versions that are read: from the one of 2013, in which nodes store masks of their values, to that of OpenVDB 13.
const VERSIONS: std::ops::RangeInclusive<u32> = 222..=225;
const UUID_LENGTH: usize = 36;
const HALF_SUFFIX: &str = "_HalfFloat";
/// Behind it, names of grids are numbered where two are the same.
const NAME_END: char = '\x1e';
const SAVED_AS_HALF: &str = "is_saved_as_half_float";

/// An entry of a file's list of grids.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Descriptor {
    /// Name that no other grid of the file has.
    pub unique_name: String,
    /// Name of its tree's type.
    pub tree_type: String,
    pub is_half: bool,
    /// Unique name of the grid whose tree it shares; empty if it has one of its own.
    pub instance_of: String,
    /// Start of its data in the file.
    pub start: i64,
}

impl Descriptor {
    pub fn name(&self) -> &str {
        self.unique_name.split(NAME_END).next().unwrap_or_default()
    }
}

/// Reads the start of a file and its list of grids.
pub(super) fn read_descriptors(bytes: &[u8]) -> Result<Vec<Descriptor>, String> {
    let mut input = Input::new(bytes);
    if input.i64() != Ok(MAGIC) {
        return Err("it is no OpenVDB file".into());
    }
    let version = input.u32()?;
    if !VERSIONS.contains(&version) {
        let (oldest, newest) = (VERSIONS.start(), VERSIONS.end());
        return Err(format!(
            "it has OpenVDB's file version {version}, and {oldest} to {newest} are read; save it again with another version"
        ));
    }
    let _library_version = [input.u32()?, input.u32()?];
    if input.byte()? == 0 {
        return Err("it is a stream without offsets of its grids; save it again as a file".into());
    }
    input.take(UUID_LENGTH)?;
    read_metadata(&mut input)?;
    let count = input.i32()?;
    let mut found = Vec::new();
    for _ in 0..count {
        let (descriptor, end) = read_descriptor(&mut input)?;
        input = input.at(end)?;
        found.push(descriptor);
    }
    Ok(found)
}

/// A descriptor, and the end of its grid, where the next one begins.
fn read_descriptor(input: &mut Input) -> Result<(Descriptor, i64), String> {
    let unique_name = input.string()?;
    let tree_type = input.string()?;
    let (tree_type, is_half) = match tree_type.strip_suffix(HALF_SUFFIX) {
        Some(tree_type) => (tree_type.to_owned(), true),
        None => (tree_type, false),
    };
    let instance_of = input.string()?;
    let [start, _blocks, end] = [input.i64()?, input.i64()?, input.i64()?];
    Ok((Descriptor { unique_name, tree_type, is_half, instance_of, start }, end))
}

/// Passes metadata; true if it says that floats are saved with 16 bits.
fn read_metadata(input: &mut Input) -> Result<bool, String> {
    let mut is_half = false;
    for _ in 0..input.u32()? {
        let name = input.sized()?;
        let _type = input.sized()?;
        let value = input.sized()?;
        is_half |= name == SAVED_AS_HALF.as_bytes() && value.first().is_some_and(|byte| *byte != 0);
    }
    Ok(is_half)
}

/// Properties that stand before the tree of a grid.
pub(super) struct GridHead {
    /// Bits of how values are packed.
    pub compression: u32,
    pub is_half: bool,
    pub object_from_index: Affine3A,
}

/// Reads what stands before the tree of a grid.
pub(super) fn read_head(input: &mut Input) -> Result<GridHead, String> {
    let compression = input.u32()?;
    let is_half = read_metadata(input)?;
    let object_from_index = read_transform(input)?;
    Ok(GridHead { compression, is_half, object_from_index })
}

fn vector(input: &mut Input) -> Result<DVec3, String> {
    Ok(DVec3::new(input.f64()?, input.f64()?, input.f64()?))
}

/// Maps of OpenVDB store more than they need: scales are followed by four vectors that are made from them.
fn read_transform(input: &mut Input) -> Result<Affine3A, String> {
    let kind = input.string()?;
    let scale = |input: &mut Input| -> Result<DVec3, String> {
        let scale = vector(input)?;
        input.take(4 * 3 * size_of::<f64>())?;
        Ok(scale)
    };
    let transform = match kind.as_str() {
        "UniformScaleMap" | "ScaleMap" => DAffine3::from_scale(scale(input)?),
        "UniformScaleTranslateMap" | "ScaleTranslateMap" => {
            let translation = vector(input)?;
            DAffine3::from_translation(translation) * DAffine3::from_scale(scale(input)?)
        }
        "TranslationMap" => DAffine3::from_translation(vector(input)?),
        "AffineMap" | "UnitaryMap" => {
            // Row vectors are multiplied from the left: rows of theirs are columns of ours.
            let mut row = || -> Result<DVec3, String> {
                let row = vector(input)?;
                input.f64()?;
                Ok(row)
            };
            let [x, y, z, translation] = [row()?, row()?, row()?, row()?];
            DAffine3::from_mat3_translation(DMat3::from_cols(x, y, z), translation)
        }
        "NonlinearFrustumMap" => {
            return Err("it fills a camera's frustum, which is not supported; resample it to a box".into());
        }
        other => return Err(format!("its transform '{other}' is not known")),
    };
    let transform = transform.as_affine3a();
    let determinant = transform.matrix3.determinant();
    if !transform.is_finite() || !determinant.is_normal() {
        return Err("its transform is flat or not finite; give it a voxel size above 0".into());
    }
    Ok(transform)
}
