//! NPZ, the container of NumPy's arrays: a zip archive with a `.npy` file for each (NumPy's NEP 1, format 1.0).
//!
//! Arrays are little-endian, in C's order, stored without compression: readers map or copy them at the disk's speed. Times of
//! members are the epoch of zip, 1980: equal arrays give equal bytes. Nothing in it needs pickle. Limit: 4 GiB an archive are
//! exceeded by zip64 alone, which NumPy reads.

use crate::error::{Error, Result};
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, DateTime, ZipArchive, ZipWriter};

/// Headers end at a multiple of this many bytes.
const ALIGNMENT: usize = 64;

/// Values that are turned into bytes at a time.
const CHUNK: usize = 1 << 14;

/// A number that arrays hold.
pub trait Scalar: Copy {
    /// Its type in a header.
    const TYPE: &'static str;
    /// Appends its bytes.
    fn put(self, bytes: &mut Vec<u8>);
}

impl Scalar for f32 {
    const TYPE: &'static str = "<f4";
    fn put(self, bytes: &mut Vec<u8>) {
        bytes.extend(self.to_le_bytes());
    }
}

impl Scalar for f64 {
    const TYPE: &'static str = "<f8";
    fn put(self, bytes: &mut Vec<u8>) {
        bytes.extend(self.to_le_bytes());
    }
}

impl Scalar for i32 {
    const TYPE: &'static str = "<i4";
    fn put(self, bytes: &mut Vec<u8>) {
        bytes.extend(self.to_le_bytes());
    }
}

impl Scalar for bool {
    const TYPE: &'static str = "|b1";
    fn put(self, bytes: &mut Vec<u8>) {
        bytes.push(u8::from(self));
    }
}

/// An NPZ file that is being written.
pub struct Npz {
    zip: ZipWriter<BufWriter<File>>,
    path: PathBuf,
}

impl Npz {
    /// An empty file at `path`; one that is there is replaced.
    ///
    /// # Errors
    /// `Io` naming the file.
    pub fn create(path: &Path) -> Result<Self> {
        let file = File::create(path).map_err(|e| Error::io(path, e))?;
        Ok(Self { zip: ZipWriter::new(BufWriter::new(file)), path: path.to_path_buf() })
    }

    /// Adds an array: as many values as the product of `shape`, which is 1 for a shape without axes.
    ///
    /// # Errors
    /// `Io` naming the file.
    pub fn array<T: Scalar>(&mut self, name: &str, shape: &[usize], values: &[T]) -> Result<()> {
        assert_eq!(shape.iter().product::<usize>(), values.len(), "shape and values of {name} differ");
        self.begin(name, T::TYPE, shape, size_of_val(values))?;
        let mut bytes = Vec::with_capacity(CHUNK * size_of::<T>());
        for chunk in values.chunks(CHUNK) {
            bytes.clear();
            chunk.iter().for_each(|v| v.put(&mut bytes));
            self.put(&bytes)?;
        }
        Ok(())
    }

    /// Adds an array of texts, as NumPy's fixed-width Unicode: UTF-32, padded by zeros.
    ///
    /// # Errors
    /// `Io` naming the file.
    pub fn texts(&mut self, name: &str, shape: &[usize], texts: &[&str]) -> Result<()> {
        assert_eq!(shape.iter().product::<usize>(), texts.len(), "shape and texts of {name} differ");
        let width = texts.iter().map(|t| t.chars().count()).max().unwrap_or(0).max(1);
        self.begin(name, &format!("<U{width}"), shape, 4 * width * texts.len())?;
        for text in texts {
            let mut bytes: Vec<u8> = text.chars().flat_map(|c| u32::from(c).to_le_bytes()).collect();
            bytes.resize(4 * width, 0);
            self.put(&bytes)?;
        }
        Ok(())
    }

    /// Ends the file, with a comment on the archive.
    ///
    /// # Errors
    /// `Io` naming the file.
    pub fn finish(mut self, comment: &str) -> Result<()> {
        let end = self.zip.set_raw_comment(comment.as_bytes().into()).and_then(|()| self.zip.finish());
        end.map_err(|e| Error::io(&self.path, e.into()))?.flush().map_err(|e| Error::io(&self.path, e))
    }

    /// Begins the member of an array whose values take so many bytes.
    fn begin(&mut self, name: &str, kind: &str, shape: &[usize], size: usize) -> Result<()> {
        let header = header(kind, shape);
        let options = SimpleFileOptions::default()
            .compression_method(CompressionMethod::Stored)
            .last_modified_time(DateTime::default())
            .large_file(header.len() + size > u32::MAX as usize);
        self.zip.start_file(format!("{name}.npy"), options).map_err(|e| Error::io(&self.path, e.into()))?;
        self.put(&header)
    }

    fn put(&mut self, bytes: &[u8]) -> Result<()> {
        self.zip.write_all(bytes).map_err(|e| Error::io(&self.path, e))
    }
}

/// The comment on the archive `path`; none where it is no archive.
pub fn comment(path: &Path) -> Option<String> {
    let archive = ZipArchive::new(File::open(path).ok()?).ok()?;
    Some(String::from_utf8_lossy(archive.comment()).into_owned())
}

/// The start of a `.npy` file.
fn header(kind: &str, shape: &[usize]) -> Vec<u8> {
    let axes: String = shape.iter().map(|n| format!("{n}, ")).collect();
    // A tuple of one needs its comma, others may have it, too.
    let mut text = format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': ({}), }}", axes.trim_end());
    let start = 10;
    let padding = (start + text.len() + 1).next_multiple_of(ALIGNMENT) - start - text.len() - 1;
    text.extend(std::iter::repeat_n(' ', padding));
    text.push('\n');
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((text.len() as u16).to_le_bytes());
    bytes.extend(text.as_bytes());
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn headers_are_aligned_and_say_what_follows() {
        for (shape, tuple) in [(&[][..], "()"), (&[7], "(7,)"), (&[2, 3], "(2, 3,)")] {
            let bytes = header("<f4", shape);
            assert!(bytes.len().is_multiple_of(ALIGNMENT) && bytes.ends_with(b"\n"));
            assert_eq!(usize::from(u16::from_le_bytes([bytes[8], bytes[9]])), bytes.len() - 10);
            let text = String::from_utf8_lossy(&bytes[10..]).into_owned();
            let expected = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': {tuple}, }}");
            assert_eq!(text.trim_end(), expected);
        }
    }
}
