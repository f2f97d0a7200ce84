use super::blosc;
use super::input::Input;
use flate2::{Decompress, FlushDecompress, Status};
use half::f16;
use std::borrow::Cow;

/// A value of a grid; scalars are all in the first channel.
pub(super) type Value = [f32; 3];

const ZIP: u32 = 1;
const ACTIVE_MASK: u32 = 2;
const BLOSC: u32 = 4;

/// Numbers that a tree holds.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Element {
    Half,
    Float,
    Double,
    Int32,
    Int64,
}

impl Element {
    fn size(self) -> usize {
        match self {
            Self::Half => 2,
            Self::Float | Self::Int32 => 4,
            Self::Double | Self::Int64 => 8,
        }
    }

    fn decode(self, bytes: &[u8]) -> Option<f32> {
        Some(match self {
            Self::Half => f16::from_le_bytes(*bytes.first_chunk()?).to_f32(),
            Self::Float => f32::from_le_bytes(*bytes.first_chunk()?),
            Self::Double => f64::from_le_bytes(*bytes.first_chunk()?) as f32,
            Self::Int32 => i32::from_le_bytes(*bytes.first_chunk()?) as f32,
            Self::Int64 => i64::from_le_bytes(*bytes.first_chunk()?) as f32,
        })
    }
}

/// Type of a tree's values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ValueType {
    element: Element,
    pub channels: usize,
}

impl ValueType {
    /// Type of the values of a tree, from the name of the tree's type.
    pub fn of(tree_type: &str) -> Result<Self, String> {
        let (element, channels) = match tree_type {
            "Tree_half_5_4_3" => (Element::Half, 1),
            "Tree_float_5_4_3" => (Element::Float, 1),
            "Tree_double_5_4_3" => (Element::Double, 1),
            "Tree_int32_5_4_3" => (Element::Int32, 1),
            "Tree_int64_5_4_3" => (Element::Int64, 1),
            "Tree_vec3s_5_4_3" => (Element::Float, 3),
            "Tree_vec3d_5_4_3" => (Element::Double, 3),
            "Tree_vec3i_5_4_3" => (Element::Int32, 3),
            other => {
                let kind = other.trim_start_matches("Tree_").split('_').next().unwrap_or(other);
                return Err(format!("values of type '{kind}' are not supported; convert it to floats"));
            }
        };
        Ok(Self { element, channels })
    }

    /// Value of numbers of some type, one a channel.
    fn value(self, element: Element, bytes: &[u8]) -> Result<Value, String> {
        let mut value = [0.0; 3];
        for (channel, number) in value[..self.channels].iter_mut().zip(bytes.chunks(element.size())) {
            *channel = element.decode(number).ok_or("a value is damaged")?;
        }
        Ok(value)
    }

    /// Reads a value that is never packed.
    pub fn read(self, input: &mut Input) -> Result<Value, String> {
        let bytes = input.take(self.channels * self.element.size())?;
        self.value(self.element, bytes)
    }
}

/// Way in which the values of a tree's nodes are stored.
pub(super) struct ValueReader {
    pub value_type: ValueType,
    /// Type of the numbers of nodes: halves, if floats were saved so.
    stored: Element,
    compression: u32,
    pub background: Value,
}

/// Meaning of a node's first byte for its inactive values. Numbers: `io/Compression.h` of OpenVDB.
mod inactive {
    pub const BACKGROUND: u8 = 0;
    pub const ONE: u8 = 2;
    pub const MASKED_BACKGROUND: u8 = 3;
    pub const MASKED_ONE: u8 = 4;
    pub const MASKED_TWO: u8 = 5;
    pub const STORED: u8 = 6;
}

impl ValueReader {
    pub fn new(value_type: ValueType, is_half: bool, compression: u32) -> Self {
        let is_real = matches!(value_type.element, Element::Float | Element::Double);
        let stored = if is_half && is_real { Element::Half } else { value_type.element };
        Self { value_type, stored, compression, background: [0.0; 3] }
    }

    /// Reads the values of a node; `active` has a bit for each.
    pub fn read(&self, input: &mut Input, active: &[u8], values: &mut [Value]) -> Result<(), String> {
        let kind = input.byte()?;
        if kind > inactive::STORED {
            return Err("a node is damaged".into());
        }
        let mut others = [self.background; 2];
        if kind != inactive::BACKGROUND {
            others[0] = self.background.map(|channel| -channel);
        }
        if matches!(kind, inactive::ONE | inactive::MASKED_ONE | inactive::MASKED_TWO) {
            others[0] = self.value_type.read(input)?;
        }
        if kind == inactive::MASKED_TWO {
            others[1] = self.value_type.read(input)?;
        }
        let is_masked =
            matches!(kind, inactive::MASKED_BACKGROUND | inactive::MASKED_ONE | inactive::MASKED_TWO);
        let selection = if is_masked { input.take(active.len())? } else { &[] };
        let stores_active_alone = self.compression & ACTIVE_MASK != 0 && kind != inactive::STORED;
        let ones = active.iter().map(|byte| byte.count_ones() as usize).sum::<usize>();
        let count = if stores_active_alone { ones } else { values.len() };
        let numbers = self.read_packed(input, count)?;
        let mut numbers = numbers.chunks(self.value_type.channels * self.stored.size());
        for (place, value) in values.iter_mut().enumerate() {
            *value = if !stores_active_alone || has_bit(active, place) {
                let bytes = numbers.next().ok_or("a node is damaged")?;
                self.value_type.value(self.stored, bytes)?
            } else {
                others[usize::from(is_masked && has_bit(selection, place))]
            };
        }
        Ok(())
    }

    /// Bytes of as many values, unpacked.
    fn read_packed<'a>(&self, input: &mut Input<'a>, count: usize) -> Result<Cow<'a, [u8]>, String> {
        let length = count * self.value_type.channels * self.stored.size();
        let stands_alone = self.compression & (ZIP | BLOSC) == 0;
        // No halves are written as nothing; of other numbers there is an empty chunk.
        let is_left_out = count == 0 && self.stored != self.value_type.element;
        if stands_alone || is_left_out {
            return Ok(Cow::Borrowed(input.take(length)?));
        }
        let packed_length = input.i64()?;
        if packed_length <= 0 {
            let is_whole = usize::try_from(packed_length.unsigned_abs()) == Ok(length);
            return if is_whole {
                Ok(Cow::Borrowed(input.take(length)?))
            } else {
                Err("a node is damaged".into())
            };
        }
        let packed = input.take(usize::try_from(packed_length).map_err(|_| "a node is damaged")?)?;
        let mut bytes = vec![0; length];
        if self.compression & BLOSC != 0 {
            blosc::decode(packed, &mut bytes)?;
        } else {
            let mut zlib = Decompress::new(true);
            let status = zlib.decompress(packed, &mut bytes, FlushDecompress::Finish);
            if !matches!(status, Ok(Status::StreamEnd)) || zlib.total_out() != length as u64 {
                return Err("a node is damaged; its zlib stream does not have its length".into());
            }
        }
        Ok(Cow::Owned(bytes))
    }
}

/// True if a mask has the bit of a place.
pub(super) fn has_bit(mask: &[u8], place: usize) -> bool {
    mask[place / 8] >> (place % 8) & 1 != 0
}
