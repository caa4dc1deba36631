//! Mesh prims as surfaces: which material each face has, and which mesh instances share.

use super::material::Fallback;
use super::mesh::{self, FaceMaterials, MaterialUse, Topology};
use super::walk::{MAX_SURFACES, Placed, State, Walk, constant_color};
use super::{binding, read, texture};
use crate::error::Warnings;
use crate::scene::SurfaceOrigin;
use openusd::usd::Prim;

/// A mesh is shared by all surfaces with the same source prim, materials and inherited colour.
pub type MeshKey = (String, MaterialUse, Vec<MaterialUse>, Option<[u32; 3]>);

impl Walk {
    /// Adds the surface of the Mesh prim `prim`.
    pub fn place_mesh(&mut self, prim: &Prim, state: &State) {
        if self.surfaces.len() >= MAX_SURFACES {
            self.warnings.add(prim.path(), format!("surfaces beyond the first {MAX_SURFACES} were left out"));
            return;
        }
        let Some(mesh) = self.shared_mesh(prim, state) else { return };
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
        self.surfaces.push(Placed { name: path.clone(), prim: path, mesh, world: state.world, origin });
    }

    /// The index of the mesh of `prim`, built where no surface has used it before.
    fn shared_mesh(&mut self, prim: &Prim, state: &State) -> Option<usize> {
        let w = &mut self.warnings;
        let double_sided = read::boolean(prim, "doubleSided", w).unwrap_or(false);
        let fallback = Fallback {
            color: state.color,
            opacity: read::value(prim, "primvars:displayOpacity", w).and_then(read::to_floats).and_then(single),
            varying: read::is_authored(prim, "primvars:displayColor") && constant_color(prim, w).is_none(),
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
        // Instances share the prim that their prototype holds.
        let source = match &state.instance {
            Some(_) => prim.prim_in_prototype().ok().flatten().unwrap_or_else(|| prim.clone()),
            None => prim.clone(),
        };
        let uses = subsets.iter().map(|(_, usage)| *usage).collect();
        let color = state.color.map(|c| c.to_array().map(f32::to_bits));
        let key: MeshKey = (source.path().as_str().to_owned(), default, uses, color);
        if let Some(&mesh) = self.meshes.get(&key) {
            return Some(mesh);
        }
        let topology = Topology::read(prim, w)?;
        let materials = face_materials(default, &subsets, topology.sizes().faces, w);
        let name = prim.path().as_str().to_owned();
        let mesh = mesh::build(prim, name, &topology, &materials, state.color, w);
        for warning in texture::missing_uv_sets(&mesh, self.materials.all()) {
            w.add(prim.path(), warning);
        }
        let index = self.scene.meshes.len();
        self.scene.meshes.push(mesh);
        self.meshes.insert(key, index);
        Some(index)
    }
}

/// The material of each face from the subsets' face lists.
fn face_materials(
    default: MaterialUse,
    subsets: &[(Prim, MaterialUse)],
    faces: usize,
    warnings: &mut Warnings,
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
