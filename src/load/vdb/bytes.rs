//! Little-endian numbers one after the other, checked against the end.

use glam::DVec3;

/// Why a file can't be read.
#[derive(Debug)]
pub(super) enum Fault {
    /// It ends too soon, or says what can't be.
    Cut,
    Broken(String),
    Unsupported(String),
}

/// A place in the bytes of a file.
pub(super) struct Bytes<'a> {
    all: &'a [u8],
    at: usize,
}

/// Longest text [bytes].
const MOST_TEXT: usize = 1 << 16;

impl<'a> Bytes<'a> {
    pub fn new(all: &'a [u8], at: usize) -> Self {
        Self { all, at }
    }

    pub fn seek(&mut self, at: usize) -> Result<(), Fault> {
        self.at = at;
        if at <= self.all.len() { Ok(()) } else { Err(Fault::Cut) }
    }

    /// The next `count` bytes.
    pub fn take(&mut self, count: usize) -> Result<&'a [u8], Fault> {
        let end = self.at.checked_add(count).ok_or(Fault::Cut)?;
        let taken = self.all.get(self.at..end).ok_or(Fault::Cut)?;
        self.at = end;
        Ok(taken)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], Fault> {
        self.take(N)?.try_into().map_err(|_| Fault::Cut)
    }

    pub fn u8(&mut self) -> Result<u8, Fault> {
        self.array().map(|[byte]| byte)
    }

    pub fn u32(&mut self) -> Result<u32, Fault> {
        self.array().map(u32::from_le_bytes)
    }

    pub fn i64(&mut self) -> Result<i64, Fault> {
        self.array().map(i64::from_le_bytes)
    }

    pub fn f32(&mut self) -> Result<f32, Fault> {
        self.array().map(f32::from_le_bytes)
    }

    pub fn f64(&mut self) -> Result<f64, Fault> {
        self.array().map(f64::from_le_bytes)
    }

    pub fn vec3(&mut self) -> Result<DVec3, Fault> {
        Ok(DVec3::new(self.f64()?, self.f64()?, self.f64()?))
    }

    /// A place in the file.
    pub fn offset(&mut self) -> Result<usize, Fault> {
        usize::try_from(self.i64()?).map_err(|_| Fault::Cut)
    }

    /// A text with its length before it.
    pub fn text(&mut self) -> Result<String, Fault> {
        let length = self.u32()? as usize;
        if length > MOST_TEXT {
            return Err(Fault::Cut);
        }
        Ok(String::from_utf8_lossy(self.take(length)?).into_owned())
    }
}
