//! Chunks of Blosc 1, as far as OpenVDB writes them: LZ4, bytes shuffled or not. Layout: Blosc's README_CHUNK_FORMAT.

const HEADER: usize = 16;
const SHUFFLED: u8 = 0x1;
const COPIED: u8 = 0x2;
const BITS_SHUFFLED: u8 = 0x4;
const NOT_SPLIT: u8 = 0x10;
/// Bits of the flags that name the compressor.
const COMPRESSOR_SHIFT: u8 = 5;
const COMPRESSORS: [&str; 5] = ["BloscLZ", "LZ4", "Snappy", "Zlib", "Zstandard"];
const LZ4: usize = 1;
/// Blocks are split into a stream for each byte of a value up to this size of values, and from this many values on.
const MOST_STREAMS: usize = 16;
const LEAST_SPLIT: usize = 128;

const DAMAGED: &str = "a Blosc chunk is damaged";

/// Decodes a chunk that stands for exactly as many bytes as `out` has.
pub(super) fn decode(chunk: &[u8], out: &mut [u8]) -> Result<(), String> {
    let header = chunk.get(..HEADER).ok_or(DAMAGED)?;
    let (flags, value_size) = (header[2], usize::from(header[3]).max(1));
    let [length, block_size] = [4, 8].map(|at| number(header, at));
    if length? != out.len() {
        return Err(DAMAGED.into());
    }
    if out.is_empty() {
        return Ok(());
    }
    if flags & COPIED != 0 {
        out.copy_from_slice(chunk.get(HEADER..HEADER + out.len()).ok_or(DAMAGED)?);
        return Ok(());
    }
    let compressor = usize::from(flags >> COMPRESSOR_SHIFT);
    if flags & BITS_SHUFFLED != 0 || compressor != LZ4 {
        let name = COMPRESSORS.get(compressor).unwrap_or(&"an unknown method");
        return Err(format!("it is compressed by Blosc with {name} in a way that OpenVDB does not write"));
    }
    let block_size = block_size?;
    if block_size == 0 {
        return Err(DAMAGED.into());
    }
    let may_split =
        flags & NOT_SPLIT == 0 && value_size <= MOST_STREAMS && block_size / value_size >= LEAST_SPLIT;
    let mut shuffled = vec![0; block_size.min(out.len())];
    for (number_of_block, block) in out.chunks_mut(block_size).enumerate() {
        let start = number(chunk, HEADER + 4 * number_of_block)?;
        let streams = if may_split && block.len() == block_size { value_size } else { 1 };
        let packed = chunk.get(start..).ok_or(DAMAGED)?;
        if flags & SHUFFLED == 0 || value_size == 1 {
            decode_block(packed, block, streams)?;
        } else {
            let shuffled = &mut shuffled[..block.len()];
            decode_block(packed, shuffled, streams)?;
            unshuffle(shuffled, block, value_size);
        }
    }
    Ok(())
}

/// A number of 32 bits.
fn number(bytes: &[u8], at: usize) -> Result<usize, String> {
    let four = bytes.get(at..).and_then(|rest| rest.first_chunk::<4>()).ok_or(DAMAGED)?;
    Ok(u32::from_le_bytes(*four) as usize)
}

/// Decodes the streams of a block, one behind the other, each behind its length.
fn decode_block(mut packed: &[u8], block: &mut [u8], streams: usize) -> Result<(), String> {
    if !block.len().is_multiple_of(streams) {
        return Err(DAMAGED.into());
    }
    for stream in block.chunks_mut(block.len() / streams) {
        let length = number(packed, 0)?;
        let bytes = packed.get(4..).and_then(|rest| rest.get(..length)).ok_or(DAMAGED)?;
        if length == stream.len() {
            stream.copy_from_slice(bytes);
        } else if !matches!(lz4_flex::block::decompress_into(bytes, stream), Ok(length) if length == stream.len())
        {
            return Err(DAMAGED.into());
        }
        packed = &packed[4 + length..];
    }
    Ok(())
}

/// Gathers the bytes of each value: the first bytes of all values come first, then the second ones.
fn unshuffle(shuffled: &[u8], block: &mut [u8], value_size: usize) {
    let values = block.len() / value_size;
    for (value, bytes) in block.chunks_exact_mut(value_size).enumerate() {
        for (plane, byte) in bytes.iter_mut().enumerate() {
            *byte = shuffled[plane * values + value];
        }
    }
    let whole = values * value_size;
    block[whole..].copy_from_slice(&shuffled[whole..]);
}
