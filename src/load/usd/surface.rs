//! Gprims as surfaces: which material each face has, and which mesh instances share.

use super::geometry::{self, Geometry, Topology};
use super::material::{Fallback, Glow, Sync};
use super::mesh::{self, FaceMaterials, MaterialUse};
use super::read::{self, Reading};
use super::walk::{MAX_SURFACES, Placed, State, Walk, constant_color};
use super::{binding, light, shape, skel, subdivision, texture};
use crate::color::Rgb;
use crate::scene::{Contribution, Mesh, SurfaceOrigin};
use glam::{DMat4, Vec3};
use openusd::usd::Prim;
use std::collections::HashMap;
use std::hash::Hasher;

/// A mesh is shared by all surfaces with the same source prim, materials, inherited colour and pose.
#[derive(PartialEq, Eq, Hash)]
pub struct MeshKey {
    source: String,
    default: MaterialUse,
    subsets: Vec<MaterialUse>,
    color: Option<[u32; 3]>,
    /// Of a mesh that a skeleton moves.
    pose: Option<u64>,
}

/// A mesh, the strength [bits of nits] and the mode of a light on its surface.
pub type ShiningKey = (usize, [u32; 3], Sync, Contribution);

/// The materials of a gprim: its own, and those of its subsets.
struct MaterialUses {
    default: MaterialUse,
    subsets: Vec<(Prim, MaterialUse)>,
}

impl MaterialUses {
    /// True where one shows the prim's displayColor.
    fn read_color(&self) -> bool {
        self.default.display_color || self.subsets.iter().any(|(_, usage)| usage.display_color)
    }
}

impl Walk {
    /// Adds the surface of `prim`, a mesh or an implicit shape of type `kind`.
    pub fn place_gprim(&mut self, prim: &Prim, kind: &str, state: &State) {
        if self.surfaces.len() >= MAX_SURFACES {
            self.warnings.add(prim.path(), format!("surfaces beyond the first {MAX_SURFACES} were left out"));
            return;
        }
        let Some(mut mesh) = self.shared_mesh(prim, kind, state) else { return };
        if prim.has_api_schema("LightAPI").unwrap_or(false) {
            mesh = self.shining(prim, mesh, state);
        }
        let path = prim.path().as_str();
        let (root, instanced) = match &state.instance {
            // The instance prim itself can hold opinions; what is below it can't.
            Some(root) if &**root != path => (root.to_string(), true),
            _ => (String::new(), false),
        };
        let origin = if instanced {
            let prim = path.get(root.len()..).unwrap_or_default().trim_start_matches('/').to_owned();
            SurfaceOrigin::UsdInstance { root, prim }
        } else {
            SurfaceOrigin::UsdPrim
        };
        let path = path.to_owned();
        self.surfaces.push(Placed {
            name: path.clone(),
            prim: path,
            mesh,
            world: state.world,
            origin,
            role: state.role,
        });
    }

    /// The index of the mesh of `prim`, built where no surface has used it before.
    fn shared_mesh(&mut self, prim: &Prim, kind: &str, state: &State) -> Option<usize> {
        let uses = self.material_uses(prim, state);
        // Instances share the prim that their prototype holds.
        let source = match &state.instance {
            Some(_) => prim.prim_in_prototype().ok().flatten().unwrap_or_else(|| prim.clone()),
            None => prim.clone(),
        };
        // A pose may be each instance's own, so that a posed mesh has to be made to be known.
        let posed = if state.in_skel_root && kind == "Mesh" { self.posed(prim, &uses) } else { None };
        let key = MeshKey {
            source: source.path().as_str().to_owned(),
            default: uses.default,
            subsets: uses.subsets.iter().map(|(_, usage)| *usage).collect(),
            color: state.color.map(|c| c.to_array().map(f32::to_bits)),
            pose: posed.as_ref().map(|geometry| hash(&geometry.topology.points)),
        };
        if let Some(&mesh) = self.meshes.get(&key) {
            return Some(mesh);
        }
        let w = &mut self.warnings;
        let mut geometry = match posed {
            Some(posed) => posed,
            None if kind == "Mesh" => Geometry::read(prim, Topology::read(prim, w)?, uses.read_color(), w),
            None => shape::read(prim, kind, w)?,
        };
        let materials = face_materials(uses.default, &uses.subsets, geometry.topology.counts.len(), w);
        if kind == "Mesh" && geometry::is_subdivided(prim, w) {
            geometry = self.subdivided(prim, geometry);
        }
        let name = prim.path().as_str().to_owned();
        let mut mesh = mesh::build(name, &geometry, &materials, state.color, &mut self.warnings);
        for warning in texture::missing_uv_sets(&mesh, self.materials.all()) {
            self.warnings.add(prim.path(), warning);
        }
        self.materials.choose_tiles(&mut mesh, &mut self.warnings);
        let index = self.scene.meshes.len();
        if geometry.remade.is_some() {
            self.remade.insert(index);
        }
        self.scene.meshes.push(mesh);
        self.meshes.insert(key, index);
        Some(index)
    }

    /// The materials of `prim` and its subsets.
    fn material_uses(&mut self, prim: &Prim, state: &State) -> MaterialUses {
        let w = &mut self.warnings;
        let double_sided = read::boolean(prim, "doubleSided", w).unwrap_or(false);
        let opacity = read::value(prim, "primvars:displayOpacity", w).and_then(read::to_floats);
        let varying_color = read::is_authored(prim, "primvars:displayColor") && constant_color(prim, w).is_none();
        let varying_opacity = opacity.as_ref().is_some_and(|values| values.len() > 1);
        let fallback = Fallback {
            color: state.color,
            opacity: opacity.and_then(single),
            varying: varying_color || varying_opacity,
            varying_opacity,
        };
        let bound = binding::bound_material(&self.stage, prim.path(), &state.bindings, &mut self.collections);
        if bound.is_none() && fallback.color.is_none() && !fallback.varying {
            w.add(prim.path(), "a mesh without material and displayColor is taken as 50 % grey");
        }
        let default = self.materials.usage(&self.stage, bound, double_sided, fallback, w);
        let mut subsets = Vec::new();
        for subset in prim.children().unwrap_or_default() {
            let is_subset = subset.type_name().ok().flatten().is_some_and(|t| t.as_str() == "GeomSubset");
            if !is_subset || read::token(&subset, "familyName", w).as_deref() != Some("materialBind") {
                continue;
            }
            if read::token(&subset, "elementType", w).is_some_and(|kind| kind != "face") {
                w.add(subset.path(), "a material subset of points or edges was left out");
                continue;
            }
            let names = subset.authored_property_names().unwrap_or_default();
            let level = binding::level(&subset, &names, &state.bindings, w);
            let bound = binding::bound_material(&self.stage, subset.path(), &level, &mut self.collections);
            subsets.push((subset, self.materials.usage(&self.stage, bound, double_sided, fallback, w)));
        }
        MaterialUses { default, subsets }
    }

    /// The mesh `prim`, below a SkelRoot, in its pose; `None` where it has no faces.
    fn posed(&mut self, prim: &Prim, uses: &MaterialUses) -> Option<Geometry> {
        let topology = Topology::read(prim, &mut self.warnings)?;
        let mut geometry = Geometry::read(prim, topology, uses.read_color(), &mut self.warnings);
        skel::pose(prim, &mut geometry, &mut self.skeletons, &mut self.warnings);
        Some(geometry)
    }

    fn subdivided(&mut self, prim: &Prim, geometry: Geometry) -> Geometry {
        if self.subdivide == 0 {
            let message =
                "a subdivision surface is taken as its control cage, with flat faces; --subdivide N refines it";
            self.warnings.add(prim.path(), message);
            return geometry;
        }
        subdivision::refine(prim, geometry, self.subdivide, &mut self.warnings)
    }

    /// `mesh`, placed by `world`, with the light of the mesh light `prim` on its surface.
    fn shining(&mut self, prim: &Prim, mesh: usize, state: &State) -> usize {
        let w = &mut self.warnings;
        let sync = match read::token(prim, "light:materialSyncMode", w).as_deref() {
            Some("independent") => Sync::Independent,
            Some("noMaterialResponse") => Sync::NoResponse,
            _ => Sync::Tint,
        };
        let mut radiance = light::luminance(prim, w);
        if read::boolean(prim, "inputs:normalize", w).unwrap_or(false) {
            // As of any light, by the area in the stage's own units.
            let area = area(&self.scene.meshes[mesh], &state.world) / (self.metres_per_unit * self.metres_per_unit);
            radiance = if area > 0.0 { radiance / area as f32 } else { Rgb::ZERO };
        }
        if !radiance.is_finite() {
            w.add(prim.path(), "a mesh light without a finite strength shines by its material alone");
            return mesh;
        }
        let key = (mesh, radiance.to_array().map(f32::to_bits), sync, state.contribution.clone());
        if let Some(&known) = self.shining.get(&key) {
            return known;
        }
        let glows = |&m: &u32| self.materials.all().get(m as usize).is_some_and(crate::scene::Material::is_emissive);
        if sync == Sync::Tint && !self.scene.meshes[mesh].triangle_material.iter().any(glows) {
            w.add(prim.path(), "a mesh light whose material has no emission to tint shines in its own colour");
        }
        let glow = Glow { light: prim.path().as_str(), radiance, sync, contribution: &state.contribution };
        let mut copy = self.scene.meshes[mesh].clone();
        let mut known: HashMap<u32, u32> = HashMap::new();
        for material in &mut copy.triangle_material {
            *material = *known.entry(*material).or_insert_with(|| self.materials.shining(*material, &glow));
        }
        self.scene.meshes.push(copy);
        let made = self.scene.meshes.len() - 1;
        if self.remade.contains(&mesh) {
            self.remade.insert(made);
        }
        self.shining.insert(key, made);
        made
    }
}

/// The area of `mesh` under `world` [m^2].
fn area(mesh: &Mesh, world: &DMat4) -> f64 {
    let corners = |t: &[u32; 3]| t.map(|v| world.transform_point3(mesh.positions[v as usize].as_dvec3()));
    let triangles = mesh.triangles.iter().map(corners);
    triangles.map(|[a, b, c]| (b - a).cross(c - a).length() / 2.0).filter(|a| a.is_finite()).sum()
}

/// A number for `points`, equal where they are.
fn hash(points: &[Vec3]) -> u64 {
    let mut hasher = std::hash::DefaultHasher::new();
    points.iter().flat_map(|p| p.to_array()).for_each(|v| hasher.write_u32(v.to_bits()));
    hasher.finish()
}

/// The material of each face from the subsets' face lists.
fn face_materials(
    default: MaterialUse,
    subsets: &[(Prim, MaterialUse)],
    faces: usize,
    warnings: &mut Reading,
) -> FaceMaterials {
    let mut by_face = if subsets.is_empty() { Vec::new() } else { vec![default; faces] };
    for (subset, usage) in subsets {
        let indices = read::value(subset, "indices", warnings).and_then(read::to_ints).unwrap_or_default();
        let mut outside = 0usize;
        for index in indices {
            match usize::try_from(index).ok().and_then(|i| by_face.get_mut(i)) {
                Some(face) => *face = *usage,
                None => outside += 1,
            }
        }
        if outside > 0 {
            warnings.add(format!("{} ({outside})", subset.path()), "face indices of a subset are out of range");
        }
    }
    FaceMaterials { default, by_face }
}

fn single(values: Vec<f32>) -> Option<f32> {
    match values[..] {
        [value] => Some(value),
        _ => None,
    }
}
