//! The walk over the composed stage: what is inherited down the namespace, and which prims make surfaces and lights.

use super::binding::{self, Collections, Level};
use super::material::Materials;
use super::read::{self, Reading};
use super::role;
use super::skel::Skeletons;
use super::surface::{MeshKey, ShiningKey};
use super::{camera, contribution, light, shape, volume, xform};
use crate::error::Warnings;
use crate::load::access::Access;
use crate::load::options::{LoadOptions, Purpose};
use crate::scene::{Contribution, Role, RoleOpinion, Scene, Surface, SurfaceOrigin};
use glam::{Affine3A, DMat4, Vec3};
use openusd::sdf::{Path, Specifier};
use openusd::tf::Token;
use openusd::usd::{Prim, Stage, TimeCode};
use std::collections::{BTreeSet, HashMap};
use std::path::PathBuf;
use std::rc::Rc;

/// Prims deeper than this are left out: each level takes stack, and composition time grows with the cube of the depth.
const MAX_DEPTH: usize = 500;

/// Surfaces beyond this many are left out: nested point instancers multiply.
pub const MAX_SURFACES: usize = 4_000_000;

/// The attributes of each purpose's own visibility.
const PURPOSE_VISIBILITY: [(&str, Purpose); 3] =
    [("renderVisibility", Purpose::Render), ("proxyVisibility", Purpose::Proxy), ("guideVisibility", Purpose::Guide)];

/// What a prim inherits.
#[derive(Clone)]
pub struct State {
    /// Metres, Y up, from the parent's space; for what lies in a point instancer's prototype, the prototype's root space.
    pub world: DMat4,
    /// The same of its parent.
    pub parent: DMat4,
    /// None: one that USD doesn't know, which nothing draws.
    purpose: Option<Purpose>,
    /// Purposes that are invisible here (VisibilityAPI).
    hidden: Vec<Purpose>,
    /// A SkelRoot is above, so that skeletons move meshes.
    pub in_skel_root: bool,
    pub bindings: Option<Rc<Level>>,
    /// The closest constant displayColor above.
    pub color: Option<Vec3>,
    /// What is said of roles here and above.
    pub role: RoleOpinion,
    /// What is said here and above of how lights are baked.
    pub contribution: Contribution,
    /// The outermost native instance above, as a path.
    pub instance: Option<Rc<str>>,
    depth: usize,
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
    pub role: RoleOpinion,
}

impl Placed {
    /// The prim that collections hold: the gprim, or the point instancer that places it.
    fn prim_path(&self) -> String {
        match &self.origin {
            SurfaceOrigin::UsdPoint { instancer, .. } => instancer.clone(),
            // Of an instance within an instance the outermost instancer's name comes first.
            _ => self.name.split('[').next().unwrap_or_default().to_owned(),
        }
    }
}

pub struct Walk {
    pub stage: Stage,
    pub scene: Scene,
    /// The moment that is read, and the warnings.
    pub warnings: Reading,
    pub materials: Materials,
    pub skeletons: Skeletons,
    /// Levels that subdivision surfaces are refined to.
    pub subdivide: u32,
    /// Purposes that are drawn beside the default one.
    purposes: Vec<Purpose>,
    pub surfaces: Vec<Placed>,
    /// The instancers that are being expanded, outermost first.
    pub expanding: Vec<Path>,
    pub collections: Collections,
    /// The meshes that were built, by what they were built from.
    pub meshes: HashMap<MeshKey, usize>,
    /// Meshes with the light of a mesh light on them.
    pub shining: HashMap<ShiningKey, usize>,
    /// The meshes whose faces are not their prim's own.
    pub remade: BTreeSet<usize>,
    /// Metres, Y up, from the stage's space.
    pub metres: DMat4,
    pub metres_per_unit: f64,
    pub z_up: bool,
    /// What lights wait for until everything was walked.
    pub pending: light::Pending,
    /// The files of IES profiles that were read.
    pub profiles: Vec<PathBuf>,
}

/// What the walk found.
pub struct Output {
    pub scene: Scene,
    pub warnings: Warnings,
    /// Texture and profile files that were read.
    pub textures: Vec<PathBuf>,
    /// The meshes whose faces are not their prim's own.
    pub remade: BTreeSet<usize>,
}

impl Walk {
    pub fn new(stage: Stage, options: &LoadOptions, access: &Access) -> Self {
        let mut warnings = Reading { time: options.time.map(TimeCode::new), warnings: Warnings::default() };
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
            materials: Materials::new(access, options.appearance),
            skeletons: Skeletons::default(),
            subdivide: options.subdivide,
            purposes: options.purposes(),
            surfaces: Vec::new(),
            expanding: Vec::new(),
            collections: Collections::default(),
            meshes: HashMap::new(),
            shining: HashMap::new(),
            remade: BTreeSet::new(),
            metres_per_unit,
            z_up,
            pending: light::Pending::default(),
            profiles: Vec::new(),
        }
    }

    /// Walks the whole stage.
    pub fn run(&mut self) {
        let state = State {
            world: self.metres,
            parent: self.metres,
            purpose: Some(Purpose::Default),
            hidden: Vec::new(),
            in_skel_root: false,
            bindings: None,
            color: None,
            role: RoleOpinion::default(),
            contribution: Contribution::default(),
            instance: None,
            depth: 0,
        };
        if let Ok(root) = self.stage.prim(Path::abs_root()) {
            self.visit_children(&root, &state);
        }
    }

    /// The scene, its surfaces resolved to single precision.
    pub fn finish(self) -> Output {
        let (mut scene, mut reading) = (self.scene, self.warnings);
        let prims: Vec<String> = self.surfaces.iter().map(Placed::prim_path).collect();
        scene.surfaces = self
            .surfaces
            .into_iter()
            .map(|placed| Surface {
                name: placed.name,
                mesh: placed.mesh,
                world_from_local: Affine3A::from_mat4(placed.world.as_mat4()),
                origin: placed.origin,
                role: placed.role.apply(Role::default()),
            })
            .collect();
        let (materials, textures, mut files) = self.materials.into_parts();
        scene.materials = materials;
        scene.textures = textures;
        files.extend(self.profiles);
        self.pending.settle(&mut scene, &prims, &mut reading);
        Output { scene, warnings: reading.warnings, textures: files, remade: self.remade }
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
        let Some(mut state) = self.state(prim, &names, above) else { return };
        let kind = prim.type_name().ok().flatten();
        state.in_skel_root |= kind.as_ref().is_some_and(|kind| kind.as_str() == "SkelRoot");
        let below = match kind.as_ref().map_or("", |t| t.as_str()) {
            "Material" | "Shader" | "NodeGraph" | "GeomSubset" => false,
            "PointInstancer" => {
                if self.is_drawn(&state) {
                    self.expand(prim, &state);
                }
                false
            }
            kind => {
                if self.is_drawn(&state) {
                    self.draw(prim, kind, &state);
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
        let mut state = State { depth: above.depth + 1, parent: above.world, ..above.clone() };
        let w = &mut self.warnings;
        if has("visibility") && read::token(prim, "visibility", w).as_deref() == Some("invisible") {
            return None;
        }
        if has("purpose") {
            state.purpose = match read::token(prim, "purpose", w).as_deref() {
                Some("render") => Some(Purpose::Render),
                Some("proxy") => Some(Purpose::Proxy),
                Some("guide") => Some(Purpose::Guide),
                None | Some("" | "default") => Some(Purpose::Default),
                Some(other) => {
                    w.add(prim.path(), format!("what has the unknown purpose {other} was left out"));
                    None
                }
            };
        }
        for (name, purpose) in PURPOSE_VISIBILITY {
            if has(name) {
                let is_hidden = read::token(prim, name, w).as_deref() == Some("invisible");
                state.hidden.retain(|hidden| *hidden != purpose);
                state.hidden.extend(is_hidden.then_some(purpose));
            }
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
        state.role = role::opinion(prim, names, above.role, w);
        state.contribution = contribution::opinion(prim, names, &above.contribution, w);
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

    /// True where gprims of the purpose of `state` are drawn and visible.
    fn is_drawn(&self, state: &State) -> bool {
        state.purpose.is_some_and(|purpose| {
            purpose == Purpose::Default || self.purposes.contains(&purpose) && !state.hidden.contains(&purpose)
        })
    }

    /// Makes what `prim` itself shows.
    fn draw(&mut self, prim: &Prim, kind: &str, state: &State) {
        let unsupported = |w: &mut Reading, what: &str| {
            w.add(prim.path(), format!("{what} are not supported yet and were left out"));
        };
        match kind {
            "" | "Xform" | "Scope" | "SkelRoot" | "Skeleton" | "SkelAnimation" | "BlendShape" => {}
            "Camera" if self.expanding.is_empty() => camera::read_camera(self, prim, state),
            // Those of a point instancer's prototype have no one place.
            "Camera" => {}
            // Known families that show nothing.
            kind if ["Render", "Physics"].iter().any(|family| kind.starts_with(family)) => {}
            "Mesh" => self.place_gprim(prim, kind, state),
            _ if shape::is_shape(kind) => self.place_gprim(prim, kind, state),
            _ if light::is_light(kind) => {
                if state.role.skip == Some(true) {
                    // Left out with all that lies below the prim that says so.
                } else if self.expanding.is_empty() {
                    light::read_light(self, prim, kind, state);
                } else {
                    self.warnings.add(prim.path(), "a light below a point instancer was left out");
                }
            }
            "Volume" => {
                if state.role.skip == Some(true) {
                    // Left out with all that lies below the prim that says so.
                } else if self.expanding.is_empty() {
                    volume::read_volume(self, prim, state);
                } else {
                    self.warnings.add(prim.path(), "a volume below a point instancer was left out");
                }
            }
            kind if volume::is_field(kind) => {}
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
}

/// The displayColor of `prim` where it is one colour.
pub fn constant_color(prim: &Prim, warnings: &mut Reading) -> Option<Vec3> {
    let attribute = prim.attribute("primvars:displayColor");
    let interpolation = attribute.get_metadata::<Token>("interpolation").ok().flatten();
    if interpolation.is_some_and(|i| i.as_str() != "constant") {
        return None;
    }
    read::attribute_value(&attribute, warnings).and_then(read::to_vec3s)?.first().copied()
}
