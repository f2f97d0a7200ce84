//! OpenVDB files: grids of voxels. Layout: `io/Archive.cc`, `io/Compression.h` and `tree` of OpenVDB 13.
//!
//! Files are untrusted. A tree is read twice: first for its size, so that memory is taken for what is there, and only if it is
//! not too much.

mod blosc;
mod fill;
mod header;
mod input;
#[cfg(test)]
mod tests;
mod tree;
mod values;

use crate::grid::Grid;
use header::Descriptor;
use input::Input;
use values::{ValueReader, ValueType};

/// An OpenVDB file whose list of grids has been read.
#[derive(Clone, Debug)]
pub struct VdbFile<'a> {
    bytes: &'a [u8],
    descriptors: Vec<Descriptor>,
}

impl<'a> VdbFile<'a> {
    /// Reads the list of grids of a file's bytes; what keeps it from that, in words.
    pub fn parse(bytes: &'a [u8]) -> Result<Self, String> {
        Ok(Self { bytes, descriptors: header::read_descriptors(bytes)? })
    }

    /// Names of its grids, in the order of the file.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.descriptors.iter().map(Descriptor::name)
    }

    /// Reads the first grid of that name. Voxels of one channel that are not above `clipping` become background. Fails in words if
    /// there is no such grid, it is damaged, of a kind that is not supported, or too large.
    pub fn grid(&self, name: &str, clipping: f32) -> Result<Grid, String> {
        let named = self.descriptors.iter().find(|descriptor| descriptor.name() == name);
        let descriptor = named.ok_or_else(|| format!("it has no grid '{name}'"))?;
        self.read(descriptor, clipping).map_err(|reason| format!("grid '{name}': {reason}"))
    }

    fn read(&self, descriptor: &Descriptor, clipping: f32) -> Result<Grid, String> {
        let whole = Input::new(self.bytes);
        let mut input = whole.at(descriptor.start)?;
        let mut head = header::read_head(&mut input)?;
        let mut owner = descriptor;
        if !descriptor.instance_of.is_empty() {
            let is_owner = |other: &&Descriptor| {
                other.unique_name == descriptor.instance_of && other.instance_of.is_empty()
            };
            owner = self
                .descriptors
                .iter()
                .find(is_owner)
                .ok_or("it shares the tree of a grid that is not there")?;
            input = whole.at(owner.start)?;
            let shared = header::read_head(&mut input)?;
            head = header::GridHead { object_from_index: head.object_from_index, ..shared };
        }
        let value_type = ValueType::of(&owner.tree_type)?;
        let reader = ValueReader::new(value_type, head.is_half || owner.is_half, head.compression);
        fill::read_grid(descriptor.name(), &input, &head, reader, clipping)
    }
}
