/// Bytes of a file from a place on. Numbers are little-endian.
#[derive(Clone)]
pub(super) struct Input<'a> {
    bytes: &'a [u8],
    position: usize,
}

const ENDS_EARLY: &str = "it ends too early; it was not written completely or is damaged";

impl<'a> Input<'a> {
    pub fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, position: 0 }
    }

    /// Input that starts at an offset that the file states.
    pub fn at(&self, offset: i64) -> Result<Self, String> {
        let position = usize::try_from(offset).ok().filter(|position| *position <= self.bytes.len());
        Ok(Self { bytes: self.bytes, position: position.ok_or(ENDS_EARLY)? })
    }

    pub fn take(&mut self, length: usize) -> Result<&'a [u8], String> {
        let rest = &self.bytes[self.position..];
        let taken = rest.get(..length).ok_or(ENDS_EARLY)?;
        self.position += length;
        Ok(taken)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], String> {
        let taken = self.take(N)?;
        taken.try_into().map_err(|_| ENDS_EARLY.to_owned())
    }

    pub fn byte(&mut self) -> Result<u8, String> {
        Ok(self.array::<1>()?[0])
    }

    pub fn u32(&mut self) -> Result<u32, String> {
        Ok(u32::from_le_bytes(self.array()?))
    }

    pub fn i32(&mut self) -> Result<i32, String> {
        Ok(i32::from_le_bytes(self.array()?))
    }

    pub fn i64(&mut self) -> Result<i64, String> {
        Ok(i64::from_le_bytes(self.array()?))
    }

    pub fn f64(&mut self) -> Result<f64, String> {
        Ok(f64::from_le_bytes(self.array()?))
    }

    /// Bytes behind their number.
    pub fn sized(&mut self) -> Result<&'a [u8], String> {
        let length = self.u32()?;
        self.take(length as usize)
    }

    pub fn string(&mut self) -> Result<String, String> {
        Ok(String::from_utf8_lossy(self.sized()?).into_owned())
    }
}
