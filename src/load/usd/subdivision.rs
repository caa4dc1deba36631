//! UsdGeomMesh's subdivision attributes, and a mesh with its primvars refined by them.

use super::geometry::{Attributes, Geometry, Topology};
use super::primvar::{Interpolation, Primvar};
use super::read::{self, Reading};
use crate::subdivide::{Boundary, Cage, INFINITE, Linear, Rules, Scheme, TriangleRule, Values, smooth_normals};
use glam::{Vec2, Vec3};
use openusd::usd::Prim;
use std::collections::{HashMap, HashSet};

/// Corners of a refined mesh, at most; with more, fewer levels are refined.
const MOST_CORNERS: usize = 1 << 26;

/// What a subdivided Mesh prim says about its limit surface.
struct Scheming {
    rules: Rules,
    linear: Linear,
    creases: Vec<([u32; 2], f32)>,
    corners: Vec<(u32, f32)>,
}

/// `geometry`, the cage of `prim`, refined `levels` times and moved to the limit surface, with its normals. What can't be
/// refined comes back as it was, with a warning.
pub fn refine(prim: &Prim, geometry: Geometry, levels: u32, reading: &mut Reading) -> Geometry {
    let levels_that_fit = levels_that_fit(geometry.topology.indices.len(), levels);
    if levels_that_fit < levels {
        let message =
            format!("a surface too large for {levels} levels of subdivision was refined {levels_that_fit} times");
        reading.add(prim.path(), message);
    }
    let Some(scheming) = Scheming::read(prim, reading) else { return geometry };
    let Some(cage) = cage(&scheming, &geometry) else {
        let message = "a subdivision surface with broken faces, or Loop's with faces that are no triangles, is taken as \
                       its control cage";
        reading.add(prim.path(), message);
        return geometry;
    };
    if levels_that_fit == 0 {
        return geometry;
    }
    match refined(&cage, &geometry, scheming.linear, levels_that_fit) {
        Some(refined) => refined,
        None => {
            reading.add(prim.path(), "a subdivision surface is too large to be refined; its control cage is used");
            geometry
        }
    }
}

fn levels_that_fit(corners: usize, levels: u32) -> u32 {
    let fits = |n: &u32| 4usize.checked_pow(*n).and_then(|k| k.checked_mul(corners)).is_some_and(|n| n <= MOST_CORNERS);
    (0..=levels).rev().find(fits).unwrap_or(0)
}

impl Scheming {
    fn read(prim: &Prim, reading: &mut Reading) -> Option<Self> {
        let scheme = match read::token(prim, "subdivisionScheme", reading).as_deref() {
            None | Some("catmullClark") => Scheme::CatmullClark,
            Some("loop") => Scheme::Loop,
            Some("bilinear") => Scheme::Bilinear,
            Some(other) => {
                reading.add(prim.path(), format!("the unknown subdivision scheme {other} is taken as none"));
                return None;
            }
        };
        let boundary = match read::token(prim, "interpolateBoundary", reading).as_deref() {
            Some("none") => Boundary::None,
            Some("edgeOnly") => Boundary::EdgeOnly,
            _ => Boundary::EdgeAndCorner,
        };
        let triangles = match read::token(prim, "triangleSubdivisionRule", reading).as_deref() {
            Some("smooth") => TriangleRule::Smooth,
            _ => TriangleRule::CatmullClark,
        };
        let linear = match read::token(prim, "faceVaryingLinearInterpolation", reading).as_deref() {
            Some("none") => Linear::None,
            Some("cornersOnly") => Linear::CornersOnly,
            Some("cornersPlus2") => Linear::CornersPlus2,
            Some("boundaries") => Linear::Boundaries,
            Some("all") => Linear::All,
            _ => Linear::CornersPlus1,
        };
        let rules = Rules { scheme, boundary, triangles };
        Some(Self { rules, linear, creases: creases(prim, reading), corners: sharp_points(prim, reading) })
    }
}

fn sharpness(value: f32) -> f32 {
    if value.is_nan() { 0.0 } else { value.clamp(0.0, INFINITE) }
}

/// Chains of points (creaseIndices, cut by creaseLengths) as edges; sharpness is one a chain or one an edge.
fn creases(prim: &Prim, reading: &mut Reading) -> Vec<([u32; 2], f32)> {
    let mut ints = |name: &str| read::value(prim, name, reading).and_then(read::to_ints).unwrap_or_default();
    let (indices, lengths) = (ints("creaseIndices"), ints("creaseLengths"));
    let values = read::value(prim, "creaseSharpnesses", reading).and_then(read::to_floats).unwrap_or_default();
    let per_chain = values.len() == lengths.len();
    let (mut creases, mut at) = (Vec::new(), 0usize);
    for (chain, &length) in lengths.iter().enumerate() {
        let end = at.saturating_add(usize::try_from(length).unwrap_or(0));
        let points = indices.get(at..end).unwrap_or_default();
        at = end;
        for pair in points.windows(2) {
            let value = if per_chain { values.get(chain) } else { values.get(creases.len()) };
            let ends = [pair[0], pair[1]].map(|p| u32::try_from(p).unwrap_or(u32::MAX));
            creases.push((ends, sharpness(value.copied().unwrap_or(0.0))));
        }
    }
    if at != indices.len() || !per_chain && values.len() != creases.len() {
        reading.add(
            prim.path(),
            "creases whose lengths, points and sharpnesses don't agree are followed as far as they do",
        );
    }
    creases
}

fn sharp_points(prim: &Prim, reading: &mut Reading) -> Vec<(u32, f32)> {
    let points = read::value(prim, "cornerIndices", reading).and_then(read::to_ints).unwrap_or_default();
    let values = read::value(prim, "cornerSharpnesses", reading).and_then(read::to_floats).unwrap_or_default();
    let points = points.into_iter().map(|p| u32::try_from(p).unwrap_or(u32::MAX));
    points.zip(values).map(|(point, value)| (point, sharpness(value))).collect()
}

fn cage(scheming: &Scheming, geometry: &Geometry) -> Option<Cage> {
    let whole = |values: &[i32]| values.iter().map(|&v| u32::try_from(v)).collect::<Result<Vec<u32>, _>>().ok();
    let (counts, corners) = (whole(&geometry.topology.counts)?, whole(&geometry.topology.indices)?);
    let mut holes: Vec<u32> = geometry.holes.iter().copied().collect();
    holes.sort_unstable();
    let points = geometry.topology.points.len();
    Cage::new(scheming.rules, &counts, corners, points, &scheming.creases, &scheming.corners, &holes)
}

/// Values of a fixed number of floats.
trait Row: Copy {
    const WIDTH: usize;
    fn write(self, out: &mut Vec<f32>);
    fn read(row: &[f32]) -> Self;
}

impl Row for f32 {
    const WIDTH: usize = 1;
    fn write(self, out: &mut Vec<f32>) {
        out.push(self);
    }
    fn read(row: &[f32]) -> Self {
        row[0]
    }
}

impl Row for Vec2 {
    const WIDTH: usize = 2;
    fn write(self, out: &mut Vec<f32>) {
        out.extend(self.to_array());
    }
    fn read(row: &[f32]) -> Self {
        Self::from_slice(row)
    }
}

impl Row for Vec3 {
    const WIDTH: usize = 3;
    fn write(self, out: &mut Vec<f32>) {
        out.extend(self.to_array());
    }
    fn read(row: &[f32]) -> Self {
        Self::from_slice(row)
    }
}

fn rows<T: Row>(values: impl Iterator<Item = T>) -> Values {
    let mut data = Vec::new();
    values.for_each(|v| v.write(&mut data));
    Values { width: T::WIDTH, data }
}

fn unrows<T: Row>(values: &Values) -> Vec<T> {
    values.data.chunks_exact(T::WIDTH).map(T::read).collect()
}

/// Where a primvar's values ride.
enum Seat {
    Constant,
    Uniform,
    Smooth(usize),
    Linear(usize),
    Channel(usize),
}

/// Everything that is refined together.
struct Refinement {
    cage: Cage,
    smooth: Vec<Values>,
    linear: Vec<Values>,
    /// Face-varying values over their own cages; true where they are linear everywhere.
    channels: Vec<(Cage, Values, bool)>,
}

impl Refinement {
    fn seat<T: Row>(&mut self, primvar: &Primvar<T>, linear: Linear) -> Option<Seat> {
        let value = |element: usize| primvar.values().get(primvar.number(element)?).copied();
        Some(match primvar.interpolation {
            Interpolation::Constant => Seat::Constant,
            Interpolation::Uniform => Seat::Uniform,
            Interpolation::Vertex | Interpolation::Varying => {
                let points: Option<Vec<T>> = (0..self.cage.vertex_count()).map(value).collect();
                let values = rows(points?.into_iter());
                let seats =
                    if primvar.interpolation == Interpolation::Vertex { &mut self.smooth } else { &mut self.linear };
                seats.push(values);
                let seat = seats.len() - 1;
                if primvar.interpolation == Interpolation::Vertex { Seat::Smooth(seat) } else { Seat::Linear(seat) }
            }
            Interpolation::FaceVarying => {
                let numbers = numbers(primvar, self.cage.corners().len())?;
                let (cage, corner_of_value) = self.cage.channel(&numbers, linear)?;
                let values: Option<Vec<T>> = corner_of_value.iter().map(|&corner| value(corner as usize)).collect();
                self.channels.push((cage, rows(values?.into_iter()), linear == Linear::All));
                Seat::Channel(self.channels.len() - 1)
            }
        })
    }

    fn refine(&mut self) -> Option<()> {
        self.cage = self.cage.refine(&mut self.smooth, &mut self.linear)?;
        for (cage, values, is_linear) in &mut self.channels {
            let values = std::slice::from_mut(values);
            *cage = if *is_linear { cage.refine(&mut [], values)? } else { cage.refine(values, &mut [])? };
        }
        Some(())
    }

    fn push_to_limit(&mut self) {
        self.smooth.iter_mut().for_each(|values| self.cage.push_to_limit(values));
        for (cage, values, _) in self.channels.iter_mut().filter(|(_, _, is_linear)| !is_linear) {
            cage.push_to_limit(values);
        }
    }

    fn primvar<T: Row>(&self, seat: &Seat, cage_values: &Primvar<T>) -> Primvar<T> {
        let signed = |indices: &[u32]| indices.iter().map(|&i| i as i32).collect();
        match seat {
            Seat::Constant => {
                let value = cage_values.number(0).and_then(|i| cage_values.values().get(i)).copied();
                Primvar::new(value.into_iter().collect(), Interpolation::Constant)
            }
            Seat::Uniform => {
                let number = |&face: &u32| cage_values.number(face as usize).unwrap_or(0) as i32;
                let indices = self.cage.parents().iter().map(number).collect();
                Primvar::indexed(cage_values.values().to_vec(), indices, Interpolation::Uniform)
            }
            Seat::Smooth(seat) => Primvar::new(unrows(&self.smooth[*seat]), Interpolation::Vertex),
            Seat::Linear(seat) => Primvar::new(unrows(&self.linear[*seat]), Interpolation::Varying),
            Seat::Channel(seat) => {
                let (cage, values, _) = &self.channels[*seat];
                Primvar::indexed(unrows(values), signed(cage.corners()), Interpolation::FaceVarying)
            }
        }
    }
}

/// A number for the value of each corner. Values without indices are one where they are equal: many exporters write them
/// so, and nothing of what they share would be smooth.
fn numbers<T: Row>(primvar: &Primvar<T>, corners: usize) -> Option<Vec<u32>> {
    if primvar.is_indexed() {
        return (0..corners).map(|corner| u32::try_from(primvar.number(corner)?).ok()).collect();
    }
    let mut known: HashMap<Vec<u32>, u32> = HashMap::new();
    let mut row = Vec::new();
    let number = |corner: usize| {
        row.clear();
        primvar.values().get(corner)?.write(&mut row);
        let next = known.len() as u32;
        Some(*known.entry(row.iter().map(|v| v.to_bits()).collect()).or_insert(next))
    };
    (0..corners).map(number).collect()
}

fn refined(cage: &Cage, geometry: &Geometry, linear: Linear, levels: u32) -> Option<Geometry> {
    let Attributes { uvs, color, opacity, .. } = &geometry.attributes;
    let points = rows(geometry.topology.points.iter().copied());
    let mut refinement =
        Refinement { cage: cage.clone(), smooth: vec![points], linear: Vec::new(), channels: Vec::new() };
    let uv_seats: Option<Vec<Seat>> = uvs.iter().map(|(_, set)| refinement.seat(set, linear)).collect();
    let uv_seats = uv_seats?;
    let color_seat = color.as_ref().and_then(|c| refinement.seat(c, linear));
    let opacity_seat = opacity.as_ref().and_then(|o| refinement.seat(o, linear));
    (0..levels).try_for_each(|_| refinement.refine())?;
    refinement.push_to_limit();
    let cage = &refinement.cage;
    let normals = (!cage.is_flat()).then(|| {
        let found = smooth_normals(cage, &refinement.smooth[0]);
        let turned = if geometry.left_handed { -1.0 } else { 1.0 };
        let values = found.values.into_iter().map(|n| turned * n).collect();
        Primvar::indexed(values, found.index.into_iter().map(|i| i as i32).collect(), Interpolation::FaceVarying)
    });
    let named = |((name, set), seat): (&(String, Primvar<Vec2>), &Seat)| (name.clone(), refinement.primvar(seat, set));
    let attributes = Attributes {
        normals,
        uvs: uvs.iter().zip(&uv_seats).map(named).collect(),
        color: color.as_ref().zip(color_seat.as_ref()).map(|(c, seat)| refinement.primvar(seat, c)),
        opacity: opacity.as_ref().zip(opacity_seat.as_ref()).map(|(o, seat)| refinement.primvar(seat, o)),
    };
    let holes: HashSet<u32> = (0..cage.face_count()).filter(|&f| cage.is_hidden(f)).map(|f| f as u32).collect();
    Some(Geometry {
        topology: Topology {
            points: unrows(&refinement.smooth[0]),
            counts: (0..cage.face_count()).map(|f| cage.face(f).len() as i32).collect(),
            indices: cage.corners().iter().map(|&v| v as i32).collect(),
        },
        attributes,
        holes,
        left_handed: geometry.left_handed,
        remade: Some(cage.parents().to_vec()),
    })
}
