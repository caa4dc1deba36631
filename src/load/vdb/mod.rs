//! OpenVDB files: one grid of floats, made dense (Museth 2013, "VDB: High-resolution sparse volumes with dynamic topology").
//!
//! Read are files of OpenVDB 3 and later (format 222 and up), grids of the type `Tree_float_5_4_3`, in single or half precision, plain,
//! zipped or by Blosc with LZ4, as Houdini, Blender and OpenVDB itself write them. Limits: level sets, other types of numbers and trees,
//! frusta. Densities below 0, which simulations leave, are 0.
//!
//! Nothing is taken at its word: each read is checked against the file's end, and the size of the dense grid before it is made.

mod blosc;
mod bytes;
mod values;

use super::volume::Volume;
use crate::error::{Error, Result};
use crate::scene::DensityGrid;
use bytes::{Bytes, Fault};
use glam::{DAffine3, DMat3, DMat4, DVec3, IVec3};
use values::{Mask, Values};

const MAGIC: &[u8; 8] = b" BDV\0\0\0\0";

/// The first format whose nodes have compressed masks.
const OLDEST: u32 = 222;

/// The only type of tree that is read; half floats have a suffix.
const TREE: &str = "Tree_float_5_4_3";

/// The name of the grid that holds densities, of a file with several.
const DENSITY: &str = "density";

/// Values along a side of leaves, and nodes along a side of the nodes above them, as powers of two.
const LEAF: u32 = 3;
const LOWER: u32 = 4;
const UPPER: u32 = 5;

/// Beyond this no coordinate is meant [voxels].
const FARTHEST: i32 = 1 << 28;

/// A grid as the file lists it.
struct Entry {
    name: String,
    kind: String,
    /// Where it begins.
    at: usize,
    /// Where its leaves begin.
    leaves: usize,
}

/// What a tree says before its leaves: where they are, and tiles of one value.
#[derive(Default)]
struct Topology {
    leaves: Vec<IVec3>,
    /// Lowest voxel, side, value.
    tiles: Vec<(IVec3, i32, f32)>,
}

/// True where `bytes` begin as a VDB file does.
pub fn is_vdb(bytes: &[u8]) -> bool {
    bytes.starts_with(MAGIC)
}

/// The grid `field` in the bytes of a file; none: `density`, or the only one.
///
/// # Errors
/// `Invalid` where the file is broken or has no such grid, `Unsupported` where it holds what isn't read; both name `place`.
pub fn read(place: &str, bytes: &[u8], field: Option<&str>) -> Result<Volume> {
    find(bytes, field).map_err(|fault| match fault {
        Fault::Cut => Error::invalid(place, "the VDB file is cut off or broken; export or copy it again"),
        Fault::Broken(what) => Error::invalid(place, what),
        Fault::Unsupported(what) => Error::unsupported(place, what),
    })
}

fn find(bytes: &[u8], field: Option<&str>) -> std::result::Result<Volume, Fault> {
    let mut file = Bytes::new(bytes, MAGIC.len());
    let version = file.u32()?;
    if version < OLDEST {
        return Err(Fault::Unsupported(format!("is a VDB file of format {version}; save it by OpenVDB 3 or later")));
    }
    file.take(8)?;
    if file.u8()? == 0 {
        return Err(Fault::Unsupported("is a VDB stream without offsets; save it as a file".into()));
    }
    file.take(36)?;
    metadata(&mut file)?;
    let count = file.u32()?;
    let mut entries = Vec::new();
    for _ in 0..count {
        let (name, kind, parent) = (file.text()?, file.text()?, file.text()?);
        let [at, leaves, end] = [file.offset()?, file.offset()?, file.offset()?];
        // What makes equal names unique follows a separator.
        let name = name.split('\u{1e}').next().unwrap_or_default().to_owned();
        if parent.is_empty() {
            entries.push(Entry { name, kind, at, leaves });
        }
        file.seek(end)?;
    }
    let wanted = field.unwrap_or(DENSITY);
    let entry = match entries.iter().find(|e| e.name == wanted) {
        Some(entry) => entry,
        None if field.is_none() && entries.len() == 1 => &entries[0],
        None => {
            let known = entries.iter().take(8).map(|e| e.name.as_str()).collect::<Vec<_>>().join(", ");
            return Err(Fault::Broken(format!("has no grid {wanted}; it has {known}")));
        }
    };
    grid(bytes, entry)
}

/// The grid of `entry`, dense over what is active, with a rim of empty voxels towards which it fades.
fn grid(bytes: &[u8], entry: &Entry) -> std::result::Result<Volume, Fault> {
    if !entry.kind.starts_with(TREE) {
        let message = format!("the grid {} is of the type {}; save it as a grid of floats", entry.name, entry.kind);
        return Err(Fault::Unsupported(message));
    }
    let mut file = Bytes::new(bytes, entry.at);
    let compression = file.u32()?;
    let kept = metadata(&mut file)?;
    if kept.iter().any(|(key, value)| key == "class" && value == b"level set") {
        let message = format!("the grid {} is a level set; turn it into a fog volume", entry.name);
        return Err(Fault::Unsupported(message));
    }
    let is_half = entry.kind.ends_with("_HalfFloat")
        || kept.iter().any(|(key, value)| key == "is_saved_as_half_float" && value.first() == Some(&1));
    let world_from_index = map(&mut file)?;
    if file.u32()? != 1 {
        return Err(Fault::Unsupported("a grid with several buffers a leaf; save it by OpenVDB 3 or later".into()));
    }
    let background = file.f32()?;
    let values = Values { compression, is_half, background };
    let topology = topology(&mut file, &values)?;
    let empty = || Fault::Broken(format!("the grid {} is empty", entry.name));
    let [low, high] = topology.bounds().ok_or_else(empty)?;
    let size = (high - low + 2).to_array().map(|n| n as usize);
    let count = DensityGrid::voxel_count(size).map_err(Fault::Broken)?;
    let mut dense = Dense { low: low - 1, size, values: vec![0.0; count] };
    for (at, side, value) in &topology.tiles {
        let end = *at + *side;
        for z in at.z..end.z {
            for y in at.y..end.y {
                let first = dense.index(IVec3::new(at.x, y, z));
                dense.values[first..first + *side as usize].fill(value.max(0.0));
            }
        }
    }
    let mut file = Bytes::new(bytes, entry.leaves);
    for leaf in &topology.leaves {
        let mask = Mask::read(&mut file, LEAF)?;
        let densities = values.read(&mut file, &mask)?;
        // z runs fastest.
        for (i, value) in densities.iter().enumerate().filter(|(i, _)| mask.is_on(*i)) {
            let index = dense.index(*leaf + within(i, LEAF));
            dense.values[index] = value.max(0.0);
        }
    }
    let lowest = dense.low.as_dvec3() - 0.5;
    let index_from_unit =
        DAffine3 { matrix3: DMat3::from_diagonal(DVec3::from_array(size.map(|n| n as f64))), translation: lowest };
    let grid = DensityGrid::new(size, dense.values).map_err(Fault::Broken)?;
    Ok(Volume { grid, file_from_unit: Some(world_from_index * index_from_unit) })
}

/// A dense grid in the making, x fastest.
struct Dense {
    low: IVec3,
    size: [usize; 3],
    values: Vec<f32>,
}

impl Dense {
    fn index(&self, voxel: IVec3) -> usize {
        let [x, y, z] = (voxel - self.low).to_array().map(|n| n as usize);
        (z * self.size[1] + y) * self.size[0] + x
    }
}

impl Topology {
    /// The lowest voxel that it reaches, and one beyond the highest.
    fn bounds(&self) -> Option<[IVec3; 2]> {
        let leaves = self.leaves.iter().map(|&at| (at, 1 << LEAF));
        let all = leaves.chain(self.tiles.iter().map(|&(at, side, _)| (at, side)));
        let boxes = all.map(|(at, side)| [at, at + side]);
        boxes.reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])])
    }
}

/// Where value `i` of a node with 2^`side` values along each side lies in it: z runs fastest.
fn within(i: usize, side: u32) -> IVec3 {
    let (i, low) = (i as i32, (1 << side) - 1);
    IVec3::new(i >> (2 * side), (i >> side) & low, i & low)
}

/// The tree's nodes down to the leaves, whose masks stand here and once more with their values.
fn topology(file: &mut Bytes, values: &Values) -> std::result::Result<Topology, Fault> {
    let mut found = Topology::default();
    let (tiles, roots) = (file.u32()?, file.u32()?);
    for _ in 0..tiles {
        let (at, value, is_active) = (origin(file)?, file.f32()?, file.u8()? != 0);
        if is_active && value != 0.0 {
            found.tiles.push((at, 1 << (LEAF + LOWER + UPPER), value));
        }
    }
    for _ in 0..roots {
        let upper_at = origin(file)?;
        let upper = node(file, values, UPPER, upper_at, LEAF + LOWER, &mut found)?;
        for i in upper.ones() {
            let lower_at = upper_at + within(i, UPPER) * (1 << (LEAF + LOWER));
            let lower = node(file, values, LOWER, lower_at, LEAF, &mut found)?;
            for i in lower.ones() {
                Mask::read(file, LEAF)?;
                found.leaves.push(lower_at + within(i, LOWER) * (1 << LEAF));
            }
        }
    }
    Ok(found)
}

/// A node at `at`, with 2^`side` children of 2^`below` voxels along each side: which of them are nodes; its tiles are kept.
fn node(
    file: &mut Bytes,
    values: &Values,
    side: u32,
    at: IVec3,
    below: u32,
    found: &mut Topology,
) -> std::result::Result<Mask, Fault> {
    let (children, active) = (Mask::read(file, side)?, Mask::read(file, side)?);
    let tiles = values.read(file, &active)?;
    for i in active.ones().filter(|&i| !children.is_on(i) && tiles[i] != 0.0) {
        found.tiles.push((at + within(i, side) * (1 << below), 1 << below, tiles[i]));
    }
    Ok(children)
}

/// A coordinate that is not too far for sums of it.
fn origin(file: &mut Bytes) -> std::result::Result<IVec3, Fault> {
    let at = IVec3::new(file.u32()? as i32, file.u32()? as i32, file.u32()? as i32);
    let is_near = at.to_array().iter().all(|c| (-FARTHEST..=FARTHEST).contains(c));
    if is_near { Ok(at) } else { Err(Fault::Broken("has voxels too far away; move them to the origin".into())) }
}

/// Pairs of names and values.
fn metadata<'a>(file: &mut Bytes<'a>) -> std::result::Result<Vec<(String, &'a [u8])>, Fault> {
    let count = file.u32()?;
    let mut all = Vec::new();
    for _ in 0..count {
        let (name, _kind, length) = (file.text()?, file.text()?, file.u32()?);
        all.push((name, file.take(length as usize)?));
    }
    Ok(all)
}

/// The transform of a grid: from voxels, whose middles have whole numbers, to the file's space.
fn map(file: &mut Bytes) -> std::result::Result<DAffine3, Fault> {
    let kind = file.text()?;
    let scaled = |scale: DVec3, translation: DVec3| DAffine3 { matrix3: DMat3::from_diagonal(scale), translation };
    match kind.as_str() {
        "UniformScaleMap" | "ScaleMap" => {
            let scale = file.vec3()?;
            // The voxel's size, and inverses of the scale.
            file.take(4 * 24)?;
            Ok(scaled(scale, DVec3::ZERO))
        }
        "UniformScaleTranslateMap" | "ScaleTranslateMap" => {
            let (translation, scale) = (file.vec3()?, file.vec3()?);
            file.take(4 * 24)?;
            Ok(scaled(scale, translation))
        }
        "TranslationMap" => Ok(scaled(DVec3::ONE, file.vec3()?)),
        // Matrices take row vectors.
        "AffineMap" | "UnitaryMap" => {
            let mut matrix = [0.0; 16];
            for entry in &mut matrix {
                *entry = file.f64()?;
            }
            Ok(DAffine3::from_mat4(DMat4::from_cols_array(&matrix)))
        }
        other => Err(Fault::Unsupported(format!("a grid with a {other}; resample it to a box"))),
    }
}
