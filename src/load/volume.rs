//! Files that hold grids of densities, told apart by how they begin.

use super::{npz, vdb};
use crate::error::Result;
use crate::scene::DensityGrid;
use glam::DAffine3;

/// A grid as its file has it.
#[derive(Clone, Debug)]
pub struct Volume {
    pub grid: DensityGrid,
    /// Where the grid's unit cube lies in the space of the file, where that says so.
    pub file_from_unit: Option<DAffine3>,
}

/// The grid in the bytes of a `.npy`, `.npz` or `.vdb` file; `field` names one of several, none: `density`, or the only one.
///
/// # Errors
/// `Invalid` or `Unsupported`, naming `place` and what is wrong.
pub fn read(place: &str, bytes: &[u8], field: Option<&str>) -> Result<Volume> {
    if vdb::is_vdb(bytes) {
        return vdb::read(place, bytes, field);
    }
    Ok(Volume { grid: npz::grid(place, bytes, field)?, file_from_unit: None })
}
