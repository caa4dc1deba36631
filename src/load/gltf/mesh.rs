//! Meshes: all primitives of a glTF mesh merged into one triangle mesh, in the shape that a node gives it.
//!
//! Morph targets are added, then a skin moves the vertices. Nodes that show a mesh in one shape share it; a skin, or other
//! weights, make it another mesh of the scene.

use super::accessor;
use super::document::Document;
use super::extension;
use super::morph;
use super::skin::{Influences, Skin};
use crate::error::{Error, Result, Warnings};
use crate::scene::{Mesh, TriangleOrigin, UvSet};
use ::gltf::Semantic;
use ::gltf::json;
use ::gltf::json::accessor::Type;
use ::gltf::json::mesh::Mode;
use ::gltf::json::validation::Checked;
use glam::{Vec2, Vec3, Vec4};
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet, HashMap};

/// Most vertices, and most triangles, of all meshes together. Primitives may share data, so that a small file can ask for
/// any number of them.
const MAX_ELEMENTS: usize = 1 << 27;

/// Reads meshes on first use; each is read once in each shape.
pub(super) struct MeshReader<'a> {
    document: &'a Document,
    /// Index into `meshes` of each mesh of the document that was read, by the bits of its weights and its skin.
    read: HashMap<(usize, Vec<u32>, Option<usize>), usize>,
    meshes: Vec<Mesh>,
    /// Vertices and triangles so far.
    vertices: usize,
    triangles: usize,
}

/// The accessors of a primitive's attributes, and its morph targets.
type Attributes = (Vec<(Checked<Semantic>, usize)>, String);

/// The vertices of a primitive; missing attributes are empty.
#[derive(Default)]
pub(super) struct Vertices {
    pub positions: Vec<Vec3>,
    pub normals: Vec<Vec3>,
    pub colors: Vec<Vec4>,
    pub uvs: BTreeMap<u32, Vec<Vec2>>,
    /// Whether the skin mirrors a vertex.
    mirrored: Vec<bool>,
}

/// How a node shapes its mesh.
struct Shape<'a> {
    /// Of the morph targets; those beyond its end are 0.
    weights: &'a [f32],
    skin: Option<&'a Skin>,
}

/// The index that stands for the material of primitives that name none, which follows the document's own.
pub(super) fn default_material(document: &Document) -> usize {
    document.count("materials")
}

impl<'a> MeshReader<'a> {
    pub fn new(document: &'a Document) -> Self {
        Self { document, read: HashMap::new(), meshes: Vec::new(), vertices: 0, triangles: 0 }
    }

    /// The meshes that were read.
    pub fn into_meshes(self) -> Vec<Mesh> {
        self.meshes
    }

    /// The scene's index of mesh `index` of the document, morphed by `weights` (empty: by its own) and moved by `skin`.
    pub fn read(
        &mut self,
        index: usize,
        weights: &[f32],
        skin: Option<&Skin>,
        warnings: &mut Warnings,
    ) -> Result<usize> {
        let source: json::Mesh = self.document.item("meshes", index)?;
        let is_morphed = source.primitives.iter().any(|p| p.targets.as_ref().is_some_and(|t| !t.is_empty()));
        let own = source.weights.as_deref().unwrap_or_default();
        let weights = if !is_morphed {
            &[]
        } else if weights.is_empty() {
            own
        } else {
            weights
        };
        let key = (index, weights.iter().map(|w| w.to_bits()).collect(), skin.map(|s| s.index));
        if let Some(&known) = self.read.get(&key) {
            return Ok(known);
        }
        let mesh = self.mesh(index, &source, &Shape { weights, skin }, warnings)?;
        self.meshes.push(mesh);
        self.read.insert(key, self.meshes.len() - 1);
        Ok(self.meshes.len() - 1)
    }

    fn mesh(&mut self, index: usize, source: &json::Mesh, shape: &Shape, warnings: &mut Warnings) -> Result<Mesh> {
        let place = self.document.place("meshes", index);
        let name = source.name.clone().filter(|n| !n.is_empty()).unwrap_or_else(|| format!("mesh_{index}"));
        let mut mesh = Mesh { name, ..Mesh::default() };
        let mut sets: BTreeMap<u32, Vec<Vec2>> = BTreeMap::new();
        // Normals for all vertices or for none: where some primitives lack them, those get flat ones.
        let has_normals = |p: &json::mesh::Primitive| p.attributes.contains_key(&Checked::Valid(Semantic::Normals));
        let any_normals = source.primitives.iter().any(has_normals);
        // Exporters often let primitives share their vertices and differ in indices alone; so they do here.
        let mut shared: BTreeMap<Attributes, (usize, usize, Vec<bool>)> = BTreeMap::new();
        for (part, primitive) in source.primitives.iter().enumerate() {
            let place = format!("{place} primitive {part}");
            let Some(corners) = self.corners(primitive, &place, warnings)? else { continue };
            let flat = any_normals && !has_normals(primitive);
            let targets = self.targets(index, part);
            let attributes = primitive.attributes.iter().map(|(k, v)| (k.clone(), v.value())).collect();
            let key: Attributes =
                (attributes, targets.map_or_else(String::new, |t| Value::from(t.to_vec()).to_string()));
            let known = shared.get(&key).cloned().filter(|_| !flat);
            let (first, count, mirrored) = match known {
                Some(range) => range,
                None => {
                    let vertices = self.vertices(primitive, targets.unwrap_or_default(), shape, &place)?;
                    let count = vertices.positions.len();
                    check_range(&corners, count, &place)?;
                    let mirrored = vertices.mirrored.clone();
                    let vertices = if flat { vertices.flat(&corners) } else { vertices };
                    let first = mesh.positions.len();
                    self.vertices += vertices.positions.len();
                    append(&mut mesh, &mut sets, vertices);
                    shared.insert(key, (first, count, mirrored.clone()));
                    (first, count, mirrored)
                }
            };
            check_range(&corners, count, &place)?;
            let material = primitive.material.map_or(default_material(self.document), |m| m.value());
            if material >= default_material(self.document) && primitive.material.is_some() {
                let message = format!("names material {material}, which isn't there; export the file again");
                return Err(Error::invalid(place, message));
            }
            add_triangles(&mut mesh, part, &corners, first, flat, &mirrored);
            mesh.triangle_material.resize(mesh.triangles.len(), material as u32);
        }
        let vertices = mesh.positions.len();
        mesh.colors.resize(if mesh.colors.is_empty() { 0 } else { vertices }, Vec4::ONE);
        for (set, mut coords) in sets {
            coords.resize(vertices, Vec2::ZERO);
            mesh.uvs.push(UvSet { name: uv_name(set), coords });
        }
        let repaired = repair_normals(&mut mesh);
        if repaired > 0 {
            let message = "normals without a direction were replaced by those of their triangles";
            warnings.add(format!("{place} ({repaired} vertices)"), message);
        }
        Ok(mesh)
    }

    /// The morph targets of a primitive as they stand in the document: the crate's type knows three attributes alone.
    fn targets(&self, mesh: usize, primitive: usize) -> Option<&'a [Value]> {
        let mesh = self.document.json.get("meshes")?.get(mesh)?;
        mesh.get("primitives")?.get(primitive)?.get("targets")?.as_array().map(Vec::as_slice)
    }

    /// The triangles of a primitive as vertex indices; `None`, with a warning, where it has none to bake.
    fn corners(
        &mut self,
        primitive: &json::mesh::Primitive,
        place: &str,
        warnings: &mut Warnings,
    ) -> Result<Option<Vec<[u32; 3]>>> {
        let Some(&positions) = primitive.attributes.get(&Checked::Valid(Semantic::Positions)) else {
            warnings.add(place, "the primitive has no POSITION and was left out");
            return Ok(None);
        };
        let mode = match primitive.mode {
            Checked::Valid(mode @ (Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan)) => mode,
            Checked::Valid(_) => {
                warnings.add(place, "points and lines have no surface and were left out");
                return Ok(None);
            }
            Checked::Invalid => return Err(Error::invalid(place, "has an unknown mode; export the file again")),
        };
        let draco = primitive.extensions.as_ref().is_some_and(|e| e.others.contains_key("KHR_draco_mesh_compression"));
        let accessor: json::Accessor = self.document.item("accessors", positions.value())?;
        if draco && accessor.buffer_view.is_none() {
            return Err(Error::unsupported(place, extension::DRACO_MESSAGE));
        }
        let source = primitive.indices.unwrap_or(positions);
        let count = accessor::count(self.document, source.value())?;
        self.triangles = self.triangles.saturating_add(count);
        self.within_limits(self.triangles, "triangles", place)?;
        let indices = match primitive.indices {
            Some(indices) => accessor::indices(self.document, indices.value())?,
            // The accessor itself is checked when its positions are read, before these are used.
            None => {
                accessor::check(self.document, positions.value(), Type::Vec3)?;
                (0..count as u32).collect()
            }
        };
        if mode == Mode::Triangles && indices.len() % 3 != 0 {
            warnings.add(place, "the number of corners is no multiple of 3; the last triangle was left out");
        }
        Ok(Some(triangulate(mode, &indices)))
    }

    /// The vertices of a primitive in `shape`.
    fn vertices(
        &self,
        primitive: &json::mesh::Primitive,
        targets: &[Value],
        shape: &Shape,
        place: &str,
    ) -> Result<Vertices> {
        let mut vertices = self.base_vertices(primitive, place)?;
        morph::apply(self.document, targets, shape.weights, &mut vertices, place)?;
        if let Some(skin) = shape.skin {
            let influences = self.influences(primitive)?;
            vertices.mirrored = skin.apply(&influences, &mut vertices.positions, &mut vertices.normals, place)?;
        }
        Ok(vertices)
    }

    /// The joints of a primitive's vertices and their weights.
    fn influences(&self, primitive: &json::mesh::Primitive) -> Result<Influences> {
        let mut influences = Influences::default();
        let read = |index: usize| accessor::floats(self.document, index, &[Type::Vec4], false);
        for (semantic, index) in &primitive.attributes {
            match semantic {
                Checked::Valid(Semantic::Joints(set)) => influences.joints.push((*set, read(index.value())?)),
                Checked::Valid(Semantic::Weights(set)) => influences.weights.push((*set, read(index.value())?)),
                _ => {}
            }
        }
        Ok(influences)
    }

    /// The vertices of a primitive as its attributes have them.
    fn base_vertices(&self, primitive: &json::mesh::Primitive, place: &str) -> Result<Vertices> {
        let mut vertices = Vertices::default();
        let mut lengths = BTreeSet::new();
        for (semantic, index) in &primitive.attributes {
            let Checked::Valid(semantic) = semantic else { continue };
            let read = |types: &[Type], colors: bool| {
                let count = accessor::count(self.document, index.value())?;
                self.within_limits(self.vertices.saturating_add(count), "vertices", place)?;
                accessor::floats(self.document, index.value(), types, colors)
            };
            let length = match semantic {
                Semantic::Positions => {
                    vertices.positions = read(&[Type::Vec3], false)?.rows(0.0).map(Vec3::from_array).collect();
                    vertices.positions.len()
                }
                Semantic::Normals => {
                    let normals = read(&[Type::Vec3], false)?;
                    // Quantized normals are not of unit length; broken ones are repaired at the end.
                    vertices.normals = normals.rows(0.0).map(|n| Vec3::from_array(n).normalize_or_zero()).collect();
                    vertices.normals.len()
                }
                Semantic::TexCoords(set) => {
                    let finite = |uv: [f32; 2]| Some(Vec2::from_array(uv)).filter(|uv| uv.is_finite());
                    let coords = read(&[Type::Vec2], false)?;
                    let coords: Vec<Vec2> = coords.rows(0.0).map(|uv| finite(uv).unwrap_or(Vec2::ZERO)).collect();
                    let length = coords.len();
                    vertices.uvs.insert(*set, coords);
                    length
                }
                Semantic::Colors(0) => {
                    let colors = read(&[Type::Vec3, Type::Vec4], true)?;
                    // The specification bounds them; NaN becomes 0.
                    vertices.colors = colors
                        .rows(1.0)
                        .map(|c| Vec4::from_array(c.map(|v: f32| v.max(0.0).clamp(0.0, 1.0))))
                        .collect();
                    vertices.colors.len()
                }
                _ => continue,
            };
            lengths.insert(length);
        }
        if lengths.len() > 1 {
            return Err(Error::invalid(place, "has attributes of different lengths; export the file again"));
        }
        Ok(vertices)
    }

    fn within_limits(&self, count: usize, what: &str, place: &str) -> Result<()> {
        if count > MAX_ELEMENTS {
            let message = format!("has too many {what}: {MAX_ELEMENTS} is the most; split the scene");
            return Err(Error::invalid(place, message));
        }
        Ok(())
    }
}

/// The name of texture coordinate set `set`.
pub(super) fn uv_name(set: u32) -> String {
    format!("TEXCOORD_{set}")
}

/// glTF 2.0 section 3.7.2.1: strips turn every second triangle around, fans turn about the first vertex.
fn triangulate(mode: Mode, indices: &[u32]) -> Vec<[u32; 3]> {
    match (mode, indices) {
        (Mode::TriangleStrip, _) => {
            let turn = |(i, w): (usize, &[u32])| match *w {
                [a, b, c] if i % 2 == 0 => [a, b, c],
                [a, b, c] => [a, c, b],
                _ => [0; 3],
            };
            indices.windows(3).enumerate().map(turn).collect()
        }
        (Mode::TriangleFan, [center, rim @ ..]) => {
            rim.windows(2).filter_map(|w| Some([*w.first()?, *w.last()?, *center])).collect()
        }
        _ => indices.as_chunks::<3>().0.to_vec(),
    }
}

fn check_range(corners: &[[u32; 3]], count: usize, place: &str) -> Result<()> {
    match corners.iter().flatten().find(|&&v| v as usize >= count) {
        Some(v) => {
            let message = format!("has the index {v}, but {count} vertices; export the file again");
            Err(Error::invalid(place, message))
        }
        None => Ok(()),
    }
}

/// Adds the triangles of primitive `part`, whose vertices start at `first` of the mesh; `flat`: three of them a triangle.
/// Triangles that the skin mirrors are turned round, so that their front stays in front.
fn add_triangles(mesh: &mut Mesh, part: usize, corners: &[[u32; 3]], first: usize, flat: bool, mirrored: &[bool]) {
    mesh.triangles.reserve(corners.len());
    mesh.origin.reserve(corners.len());
    for (face, &triangle) in corners.iter().enumerate() {
        let face = face as u32;
        let vertex = |k: usize| if flat { first as u32 + 3 * face + k as u32 } else { first as u32 + triangle[k] };
        let is_mirrored = mirrored.get(triangle[0] as usize).is_some_and(|m| *m);
        let order = if is_mirrored { [0, 2, 1] } else { [0, 1, 2] };
        mesh.triangles.push(order.map(vertex));
        mesh.origin.push(TriangleOrigin { part: part as u32, face, corners: order.map(|k| triangle[k]) });
    }
}

/// Adds the vertices of a primitive; what earlier primitives lack is filled in.
fn append(mesh: &mut Mesh, sets: &mut BTreeMap<u32, Vec<Vec2>>, vertices: Vertices) {
    let first = mesh.positions.len();
    mesh.positions.extend(vertices.positions);
    mesh.normals.extend(vertices.normals);
    if !vertices.colors.is_empty() {
        mesh.colors.resize(first, Vec4::ONE);
        mesh.colors.extend(vertices.colors);
    }
    for (set, coords) in vertices.uvs {
        let all = sets.entry(set).or_default();
        all.resize(first, Vec2::ZERO);
        all.extend(coords);
    }
}

impl Vertices {
    /// Three vertices of their own for each triangle, with its normal. `corners` must be in range.
    fn flat(&self, corners: &[[u32; 3]]) -> Self {
        fn pick<T: Copy>(from: &[T], corners: &[[u32; 3]]) -> Vec<T> {
            corners.iter().flatten().filter_map(|&v| from.get(v as usize).copied()).collect()
        }
        let positions = pick(&self.positions, corners);
        let turned = |c: &[u32; 3]| self.mirrored.get(c[0] as usize).is_some_and(|m| *m);
        let sides = corners.iter().map(|c| if turned(c) { -1.0 } else { 1.0 });
        let triangles = positions.as_chunks().0.iter();
        let normals = triangles.zip(sides).flat_map(|(t, side)| [face_normal(t) * side; 3]).collect();
        let uvs = self.uvs.iter().map(|(&set, coords)| (set, pick(coords, corners))).collect();
        Self { normals, colors: pick(&self.colors, corners), uvs, positions, mirrored: Vec::new() }
    }
}

/// Unit normal of a counter-clockwise triangle; zero where it has none.
fn face_normal([a, b, c]: &[Vec3; 3]) -> Vec3 {
    (*b - *a).as_dvec3().cross((*c - *a).as_dvec3()).normalize_or_zero().as_vec3()
}

/// Gives vertices whose normal is no direction that of a triangle that they belong to (+Y where there is none); the number of
/// those that triangles show.
fn repair_normals(mesh: &mut Mesh) -> usize {
    let broken = |n: &Vec3| !n.is_finite() || *n == Vec3::ZERO;
    if !mesh.normals.iter().any(broken) {
        return 0;
    }
    let mut shown = 0;
    for triangle in &mesh.triangles {
        let [Some(&a), Some(&b), Some(&c)] = triangle.map(|v| mesh.positions.get(v as usize)) else { continue };
        for &v in triangle {
            if let Some(normal) = mesh.normals.get_mut(v as usize).filter(|n| broken(n)) {
                *normal = face_normal(&[a, b, c]);
                shown += usize::from(!broken(normal));
            }
        }
    }
    for normal in mesh.normals.iter_mut().filter(|n| broken(n)) {
        *normal = Vec3::Y;
    }
    shown
}
