//! The walk over the composed stage: what is inherited down the namespace, and which prims make surfaces and lights.

use super::binding::{self, Collections, Level};
use super::material::{Fallback, Materials};
use super::mesh::{self, FaceMaterials, MaterialUse, Topology};
use super::{light, read, texture, xform};
use crate::error::Warnings;
use crate::scene::{Scene, Surface, SurfaceOrigin};
use glam::{Affine3A, DMat4, Vec3};
use openusd::sdf::{Path, Specifier};
use openusd::tf::Token;
use openusd::usd::{Prim, Stage};
use std::collections::HashMap;
use std::path::PathBuf;
use std::rc::Rc;

/// Prims deeper than this are left out: each level takes stack.
const MAX_DEPTH: usize = 2000;

/// Surfaces beyond this many are left out: nested point instancers multiply.
pub const MAX_SURFACES: usize = 4_000_000;

/// What a prim inherits.
#[derive(Clone)]
pub struct State {
    /// Metres, Y up, from the parent's space; for what lies in a point instancer's prototype, the prototype's root space.
    pub world: DMat4,
    purpose: Purpose,
    pub bindings: Option<Rc<Level>>,
    /// The closest constant displayColor above.
    color: Option<Vec3>,
    /// The outermost native instance above, as a path.
    pub instance: Option<Rc<str>>,
    depth: usize,
}

#[derive(Clone, Copy, PartialEq)]
enum Purpose {
    Drawn,
    Skipped,
}

/// A surface in the making; its transform stays in double precision until the end.
#[derive(Clone)]
pub struct Placed {
    pub name: String,
    /// The gprim's own path.
    pub prim: String,
    pub mesh: usize,
    pub world: DMat4,
    pub origin: SurfaceOrigin,
}

/// A mesh is shared by all surfaces with the same source prim, materials and inherited colour.
type MeshKey = (String, MaterialUse, Vec<MaterialUse>, Option<[u32; 3]>);

pub struct Walk {
    pub stage: Stage,
    pub scene: Scene,
    pub warnings: Warnings,
    pub materials: Materials,
    pub surfaces: Vec<Placed>,
    /// The instancers that are being expanded, outermost first.
    pub expanding: Vec<Path>,
    collections: Collections,
    meshes: HashMap<MeshKey, usize>,
    /// Metres, Y up, from the stage's space.
    pub metres: DMat4,
    pub metres_per_unit: f64,
    pub z_up: bool,
}

/// What the walk found.
pub struct Output {
    pub scene: Scene,
    pub warnings: Warnings,
    /// Texture files that were read.
    pub textures: Vec<PathBuf>,
}

impl Walk {
    pub fn new(stage: Stage) -> Self {
        let mut warnings = Warnings::default();
        let metadata = |field: &str| stage.stage_metadata(field).ok().flatten();
        let authored = metadata("metersPerUnit").and_then(read::to_float).map_or(0.01, f64::from);
        let metres_per_unit = if authored.is_finite() && authored > 0.0 {
            authored
        } else {
            warnings.add("metersPerUnit", "is no positive number; 0.01 is used");
            0.01
        };
        let z_up = metadata("upAxis").and_then(read::to_text).is_some_and(|axis| axis == "Z");
        Self {
            metres: xform::metres_from_stage(metres_per_unit, z_up),
            stage,
            scene: Scene::default(),
            warnings,
            materials: Materials::default(),
            surfaces: Vec::new(),
            expanding: Vec::new(),
            collections: Collections::default(),
            meshes: HashMap::new(),
            metres_per_unit,
            z_up,
        }
    }

    /// Walks the whole stage.
    pub fn run(&mut self) {
        let state = State {
            world: self.metres,
            purpose: Purpose::Drawn,
            bindings: None,
            color: None,
            instance: None,
            depth: 0,
        };
        if let Ok(root) = self.stage.prim(Path::abs_root()) {
            self.visit_children(&root, &state);
        }
    }

    /// The scene, its surfaces resolved to single precision.
    pub fn finish(self) -> Output {
        let mut scene = self.scene;
        scene.surfaces = self
            .surfaces
            .into_iter()
            .map(|placed| Surface {
                name: placed.name,
                mesh: placed.mesh,
                world_from_local: Affine3A::from_mat4(placed.world.as_mat4()),
                origin: placed.origin,
            })
            .collect();
        let (materials, textures, files) = self.materials.into_parts();
        scene.materials = materials;
        scene.textures = textures;
        Output { scene, warnings: self.warnings, textures: files }
    }

    fn visit_children(&mut self, prim: &Prim, state: &State) {
        match prim.children() {
            Ok(children) => children.iter().for_each(|child| self.visit(child, state)),
            Err(error) => self.warnings.add(prim.path(), format!("children could not be composed: {error}")),
        }
    }

    /// Visits `prim` and what lies below it; `above` is its parent's state.
    pub fn visit(&mut self, prim: &Prim, above: &State) {
        if !matches!(prim.specifier(), Ok(Some(Specifier::Def))) || !prim.is_active().unwrap_or(false) {
            return;
        }
        self.enter(prim, above);
    }

    /// Visits `prim` whatever its specifier says: a prototype may stand below an over or a class.
    pub fn enter(&mut self, prim: &Prim, above: &State) {
        if above.depth >= MAX_DEPTH {
            self.warnings.add(prim.path(), format!("prims more than {MAX_DEPTH} levels deep were left out"));
            return;
        }
        let names = prim.authored_property_names().unwrap_or_else(|error| {
            self.warnings.add(prim.path(), format!("properties could not be composed: {error}"));
            Vec::new()
        });
        let Some(state) = self.state(prim, &names, above) else { return };
        let kind = prim.type_name().ok().flatten();
        let below = match kind.as_ref().map_or("", |t| t.as_str()) {
            "Material" | "Shader" | "NodeGraph" | "GeomSubset" => false,
            "PointInstancer" => {
                if state.purpose == Purpose::Drawn {
                    self.expand(prim, &state);
                }
                false
            }
            kind => {
                if state.purpose == Purpose::Drawn {
                    self.draw(prim, kind, &names, &state);
                }
                true
            }
        };
        if below {
            self.visit_children(prim, &state);
        }
    }

    /// What `prim` hands down, its own transform, purpose and bindings included; `None` where it is invisible.
    fn state(&mut self, prim: &Prim, names: &[Token], above: &State) -> Option<State> {
        let has = |name: &str| names.iter().any(|n| n.as_str() == name);
        let mut state = State { depth: above.depth + 1, ..above.clone() };
        let w = &mut self.warnings;
        if has("visibility") && read::token(prim, "visibility", w).as_deref() == Some("invisible") {
            return None;
        }
        if has("purpose") {
            state.purpose = match read::token(prim, "purpose", w).as_deref() {
                Some("proxy" | "guide") => Purpose::Skipped,
                _ => Purpose::Drawn,
            };
        }
        if has("xformOpOrder") {
            let local = xform::local_xform(prim, w);
            // Below a point instancer there is no stage space to reset to but the prototype's.
            let base = match (local.resets, self.expanding.is_empty()) {
                (false, _) => above.world,
                (true, true) => self.metres,
                (true, false) => DMat4::IDENTITY,
            };
            state.world = base * local.parent_from_local;
        }
        state.bindings = binding::level(prim, names, &above.bindings, w);
        if has("primvars:displayColor")
            && let Some(color) = constant_color(prim, w)
        {
            state.color = Some(color);
        }
        if state.instance.is_none() && prim.is_instance().unwrap_or(false) {
            state.instance = Some(prim.path().as_str().into());
        }
        Some(state)
    }

    /// Makes what `prim` itself shows.
    fn draw(&mut self, prim: &Prim, kind: &str, names: &[Token], state: &State) {
        let unsupported = |w: &mut Warnings, what: &str| {
            w.add(prim.path(), format!("{what} are not supported yet and were left out"));
        };
        match kind {
            "" | "Xform" | "Scope" | "Camera" | "SkelRoot" | "Skeleton" | "SkelAnimation" | "BlendShape" => {}
            "Mesh" => {
                if names.iter().any(|n| n.as_str() == "primvars:skel:jointIndices" || n.as_str() == "skel:skeleton") {
                    self.warnings.add(prim.path(), "a skinned mesh is taken in its rest pose");
                }
                if prim.has_api_schema("LightAPI").unwrap_or(false) {
                    let what = "its LightAPI is not supported yet; it shines by its material's emission alone";
                    self.warnings.add(prim.path(), what);
                }
                self.mesh(prim, state);
            }
            "Cube" | "Sphere" | "Cylinder" | "Cone" | "Capsule" | "Plane" | "Cylinder_1" | "Capsule_1" => {
                unsupported(&mut self.warnings, &format!("implicit shapes ({kind})"));
            }
            _ if light::is_light(kind) => {
                if self.expanding.is_empty() {
                    light::read_light(self, prim, kind, state);
                } else {
                    self.warnings.add(prim.path(), "a light below a point instancer was left out");
                }
            }
            "LightFilter" => unsupported(&mut self.warnings, "light filters"),
            _ if prim.is_a("Gprim").unwrap_or(false) || prim.is_a("Boundable").unwrap_or(false) => {
                unsupported(&mut self.warnings, &format!("{kind} prims"));
            }
            _ if matches!(prim.schema_type(), Ok(None)) => {
                self.warnings.add(prim.path(), format!("prims of the unknown type {kind} were left out"));
            }
            _ => {}
        }
    }

    fn mesh(&mut self, prim: &Prim, state: &State) {
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

/// The displayColor of `prim` where it is one colour.
fn constant_color(prim: &Prim, warnings: &mut Warnings) -> Option<Vec3> {
    let attribute = prim.attribute("primvars:displayColor");
    let interpolation = attribute.get_metadata::<Token>("interpolation").ok().flatten();
    if interpolation.is_some_and(|i| i.as_str() != "constant") {
        return None;
    }
    read::attribute_value(&attribute, warnings).and_then(read::to_vec3s)?.first().copied()
}

fn single(values: Vec<f32>) -> Option<f32> {
    match values[..] {
        [value] => Some(value),
        _ => None,
    }
}
