//! The node tree, at rest or in a pose, to a flat list with world transforms and unique paths.
//!
//! Transforms are multiplied in f64, so that deep trees and far origins lose nothing that f32 can hold. The walk keeps
//! its own stack: a file decides how deep the tree is.

use super::accessor;
use super::animation::Pose;
use super::document::Document;
use super::skin::Skin;
use super::{contribution, medium, role};
use crate::error::{Error, Result, Warnings};
use crate::scene::{Contribution, RoleOpinion};
use ::gltf::json;
use ::gltf::json::accessor::Type;
use glam::{Affine3A, DAffine3, DMat4, DQuat, DVec3};
use serde_json::Value;
use std::collections::{BTreeMap, HashMap, HashSet};
use std::sync::Arc;

/// Names kept of a deeper path; a chain of a hundred thousand nodes would else take gigabytes of names.
const MAX_NAMES: usize = 256;

/// A node of the scene that holds a mesh, a light, a light profile, a camera or a medium.
pub(super) struct PlacedNode {
    /// Index into the document's nodes.
    pub index: usize,
    /// Unique path: names from the root, joined by `/`.
    pub name: String,
    pub mesh: Option<usize>,
    /// KHR_lights_punctual.
    pub light: Option<usize>,
    /// EXT_lights_area.
    pub area_light: Option<usize>,
    pub camera: Option<usize>,
    pub world_from_local: DAffine3,
    /// Weights of morph targets; empty where the mesh's own are meant.
    pub weights: Vec<f32>,
    /// The skin that the mesh is bound to, in the pose of its joints.
    pub skin: Option<Arc<Skin>>,
    /// What it says, and inherits, of its role.
    pub role: RoleOpinion,
    /// What it says, and inherits, of how its lights are baked.
    pub contribution: Contribution,
    /// EXT_mesh_gpu_instancing: transforms within the node.
    instances: Option<Vec<DAffine3>>,
}

impl PlacedNode {
    /// A name and transform for each place where the node's mesh stands.
    pub fn placements(&self) -> Vec<(String, Affine3A)> {
        match &self.instances {
            // The vertices are in world space already.
            _ if self.skin.is_some() => vec![(self.name.clone(), Affine3A::IDENTITY)],
            None => vec![(self.name.clone(), self.world_from_local.as_affine3a())],
            Some(instances) => {
                let place = |(i, local): (usize, &DAffine3)| {
                    (format!("{}[{i}]", self.name), (self.world_from_local * *local).as_affine3a())
                };
                instances.iter().enumerate().map(place).collect()
            }
        }
    }
}

/// A node that waits for its visit.
struct Visit {
    index: usize,
    world_from_parent: DAffine3,
    /// Its place in the list of names, and depth.
    parent_name: Option<usize>,
    /// What it inherits of roles, and of how lights are baked.
    role: RoleOpinion,
    contribution: Contribution,
}

/// The nodes of a document, and where they are.
struct Tree<'a> {
    document: &'a Document,
    nodes: Vec<json::Node>,
    parents: Vec<Option<usize>>,
    pose: &'a Pose,
    skins: BTreeMap<usize, Arc<Skin>>,
}

/// The nodes of the default scene that hold a mesh, a light or a camera, parents before children, each where `pose` has it.
///
/// # Errors
/// `Invalid` where nodes form a cycle, one has two parents, or what a node names is broken.
pub(super) fn flatten(document: &Document, pose: &Pose, warnings: &mut Warnings) -> Result<Vec<PlacedNode>> {
    let nodes: Vec<json::Node> =
        (0..document.count("nodes")).map(|i| document.item("nodes", i)).collect::<Result<_>>()?;
    let parents = parents(document, &nodes)?;
    let mut roots = roots(document, &parents, warnings)?;
    // A root that is also a child is visited as a child where its parent is in the scene.
    roots.sort_by_key(|&r| parents.get(r).is_some_and(Option::is_some));
    let mut tree = Tree { document, nodes, parents, pose, skins: BTreeMap::new() };

    let mut placed = Vec::new();
    let mut visited = vec![false; tree.nodes.len()];
    // (name, the parent's entry), by order of visit.
    let mut names: Vec<(String, Option<usize>)> = Vec::new();
    let mut unique = UniqueNames::default();
    let mut stack: Vec<Visit> = Vec::new();
    for root in roots {
        stack.push(Visit {
            index: root,
            world_from_parent: DAffine3::IDENTITY,
            parent_name: None,
            role: RoleOpinion::default(),
            contribution: Contribution::default(),
        });
        while let Some(visit) = stack.pop() {
            let index = visit.index;
            let Some((node, seen)) = tree.nodes.get(index).zip(visited.get_mut(index)) else {
                return Err(Error::invalid(
                    document.file(),
                    format!("there is no node {index}; export the file again"),
                ));
            };
            if std::mem::replace(seen, true) {
                if is_ancestor(&tree.parents, index) {
                    return Err(Error::invalid(
                        document.place("nodes", index),
                        "is below itself; export the file again",
                    ));
                }
                warnings.add(document.place("nodes", index), "the node is listed more than once and was placed once");
                continue;
            }
            let name = node.name.clone().filter(|n| !n.is_empty()).unwrap_or_else(|| format!("node_{index}"));
            names.push((name, visit.parent_name));
            let here = names.len() - 1;
            let extensions = node.extensions.as_ref();
            if extensions.and_then(|e| e.others.get("KHR_node_visibility")?.get("visible")) == Some(&Value::Bool(false))
            {
                warnings.add(path(&names, here), "the node is hidden (KHR_node_visibility) and was left out");
                continue;
            }
            let world_from_local = visit.world_from_parent * local_transform(node, index, pose);
            let role = role::opinion(document, index)?.over(visit.role);
            let json = document.json.get("nodes").and_then(|nodes| nodes.get(index));
            let contribution =
                contribution::opinion(json, || document.place("nodes", index))?.over(&visit.contribution);
            // The stack turns the order around.
            for child in node.children.iter().flatten().rev() {
                let child = child.value();
                stack.push(Visit {
                    index: child,
                    world_from_parent: world_from_local,
                    parent_name: Some(here),
                    role,
                    contribution: contribution.clone(),
                });
            }
            if let Some(node) =
                tree.place(index, world_from_local, role, || unique.make(path(&names, here)), warnings)?
            {
                placed.push(PlacedNode { contribution, ..node });
            }
            // A surface may be called back by settings; lights are left out here.
            if let Some(node) = placed.last_mut().filter(|n| n.index == index && n.role.skip == Some(true)) {
                (node.light, node.area_light) = (None, None);
            }
        }
    }
    Ok(placed)
}

impl Tree<'_> {
    /// Node `index` as it is placed; `None` where it holds nothing that is read.
    fn place(
        &mut self,
        index: usize,
        world_from_local: DAffine3,
        role: RoleOpinion,
        name: impl FnOnce() -> String,
        warnings: &mut Warnings,
    ) -> Result<Option<PlacedNode>> {
        let Some(node) = self.nodes.get(index) else { return Ok(None) };
        let extensions = node.extensions.as_ref();
        let other = |name: &str| extensions.and_then(|e| e.others.get(name));
        let light = extensions.and_then(|e| e.khr_lights_punctual.as_ref()).map(|l| l.light.value());
        let area_light = other("EXT_lights_area").and_then(|l| l.get("light")?.as_u64());
        let area_light = area_light.and_then(|l| usize::try_from(l).ok());
        let mesh = node.mesh.map(|m| m.value());
        let camera = node.camera.map(|c| c.value());
        let is_light = light.is_some() || area_light.is_some() || other("EXT_lights_ies").is_some();
        let is_empty = mesh.is_none() && camera.is_none() && !is_light;
        if is_empty && medium::extras(self.document, index).is_none() {
            return Ok(None);
        }
        let name = name();
        let skin = node.skin.filter(|_| mesh.is_some()).map(|s| s.value());
        let instancing = other("EXT_mesh_gpu_instancing").filter(|_| mesh.is_some());
        if skin.is_some() && instancing.is_some() {
            warnings
                .add(&name, "instances of a skinned mesh (EXT_mesh_gpu_instancing) lie on one another; one was baked");
        }
        let instances = match instancing.filter(|_| skin.is_none()) {
            Some(extension) => {
                warnings.add(&name, "instances (EXT_mesh_gpu_instancing) were baked each as a surface of its own");
                Some(instances(self.document, index, extension)?)
            }
            None => None,
        };
        let animated = self.pose.get(&index).and_then(|a| a.weights.clone());
        let weights = animated.or_else(|| node.weights.clone()).unwrap_or_default();
        let skin = skin.map(|s| self.skin(s)).transpose()?;
        let contribution = Contribution::default();
        Ok(Some(PlacedNode {
            index,
            name,
            mesh,
            light,
            area_light,
            camera,
            world_from_local,
            weights,
            skin,
            role,
            contribution,
            instances,
        }))
    }

    /// Skin `index`, its joints where the pose has them.
    fn skin(&mut self, index: usize) -> Result<Arc<Skin>> {
        if let Some(skin) = self.skins.get(&index) {
            return Ok(skin.clone());
        }
        let mut known = HashMap::new();
        let skin = Arc::new(Skin::read(self.document, index, |node| self.world_from_node(node, &mut known))?);
        self.skins.insert(index, skin.clone());
        Ok(skin)
    }

    /// World transform of any node, in the scene or not; `known` holds those that were found before. `None` where there is
    /// no such node, or it is below itself.
    fn world_from_node(&self, node: usize, known: &mut HashMap<usize, DAffine3>) -> Option<DAffine3> {
        let mut chain = Vec::new();
        let mut next = Some(node);
        let mut world = DAffine3::IDENTITY;
        while let Some(at) = next {
            if let Some(there) = known.get(&at) {
                world = *there;
                break;
            }
            chain.push(at);
            if chain.len() > self.nodes.len() {
                return None;
            }
            next = *self.parents.get(at)?;
        }
        for at in chain.into_iter().rev() {
            world *= local_transform(self.nodes.get(at)?, at, self.pose);
            known.insert(at, world);
        }
        Some(world)
    }
}

/// The parent of each node.
fn parents(document: &Document, nodes: &[json::Node]) -> Result<Vec<Option<usize>>> {
    let mut parents = vec![None; nodes.len()];
    for (index, node) in nodes.iter().enumerate() {
        for child in node.children.iter().flatten() {
            let Some(parent) = parents.get_mut(child.value()) else {
                let message = format!("has the child {}, which is no node; export the file again", child.value());
                return Err(Error::invalid(document.place("nodes", index), message));
            };
            if parent.replace(index).is_some() {
                let message = "has two parents; export the file again";
                return Err(Error::invalid(document.place("nodes", child.value()), message));
            }
        }
    }
    Ok(parents)
}

/// True where `node` is below itself. Ends after as many steps as there are nodes: another cycle may lie above it.
fn is_ancestor(parents: &[Option<usize>], node: usize) -> bool {
    let mut at = node;
    for _ in 0..parents.len() {
        match parents.get(at).copied().flatten() {
            Some(parent) if parent == node => return true,
            Some(parent) => at = parent,
            None => return false,
        }
    }
    false
}

/// The root nodes of the default scene, else of the first one, else all nodes without a parent.
fn roots(document: &Document, parents: &[Option<usize>], warnings: &mut Warnings) -> Result<Vec<usize>> {
    let scenes = document.count("scenes");
    if scenes == 0 {
        return Ok((0..parents.len()).filter(|&i| parents.get(i).is_some_and(Option::is_none)).collect());
    }
    let chosen = document.json.get("scene").and_then(Value::as_u64).and_then(|i| usize::try_from(i).ok());
    if scenes > 1 {
        let message = format!("the file has {scenes} scenes; only the default one was baked");
        warnings.add(document.file(), message);
    }
    let scene: Value = document.item("scenes", chosen.unwrap_or(0))?;
    let Some(list) = scene.get("nodes") else { return Ok(Vec::new()) };
    document.parse(list, "scenes", chosen.unwrap_or(0))
}

/// Local transform of a node, where `pose` has it; a rotation of length 0 is none.
fn local_transform(node: &json::Node, index: usize, pose: &Pose) -> DAffine3 {
    let animated = pose.get(&index).filter(|a| a.translation.is_some() || a.rotation.is_some() || a.scale.is_some());
    let own = match &node.matrix {
        Some(matrix) => {
            let matrix = DAffine3::from_mat4(DMat4::from_cols_array(&matrix.map(f64::from)));
            if animated.is_none() {
                return matrix;
            }
            // The specification forbids a matrix on an animated node; what is animated replaces that part of it.
            let (scale, rotation, translation) = matrix.to_scale_rotation_translation();
            (translation.as_vec3().to_array(), rotation.as_quat().to_array(), scale.as_vec3().to_array())
        }
        None => (
            node.translation.unwrap_or([0.0; 3]),
            node.rotation.map_or([0.0, 0.0, 0.0, 1.0], |r| r.0),
            node.scale.unwrap_or([1.0; 3]),
        ),
    };
    let animated = animated.cloned().unwrap_or_default();
    trs(animated.translation.unwrap_or(own.0), animated.rotation.unwrap_or(own.1), animated.scale.unwrap_or(own.2))
}

fn trs(translation: [f32; 3], rotation: [f32; 4], scale: [f32; 3]) -> DAffine3 {
    let rotation = DQuat::from_array(rotation.map(f64::from));
    let rotation = if rotation.length_squared() > 0.0 { rotation.normalize() } else { DQuat::IDENTITY };
    let vector = |v: [f32; 3]| DVec3::from_array(v.map(f64::from));
    DAffine3::from_scale_rotation_translation(vector(scale), rotation, vector(translation))
}

/// The transforms of EXT_mesh_gpu_instancing.
fn instances(document: &Document, node: usize, extension: &Value) -> Result<Vec<DAffine3>> {
    let attribute = |name: &str, kind: Type| -> Result<Option<accessor::Floats>> {
        let Some(index) = extension.get("attributes").and_then(|a| a.get(name)) else { return Ok(None) };
        let index: usize = document.parse(index, "nodes", node)?;
        accessor::floats(document, index, &[kind], false).map(Some)
    };
    let translations = attribute("TRANSLATION", Type::Vec3)?;
    let rotations = attribute("ROTATION", Type::Vec4)?;
    let scales = attribute("SCALE", Type::Vec3)?;
    let counts = [&translations, &rotations, &scales].map(|a| a.as_ref().map(accessor::Floats::len));
    let count = match counts.iter().flatten().copied().max() {
        Some(count) => count,
        // Attributes of its own alone: as many instances, all in one place.
        None => match extension.get("attributes").and_then(Value::as_object).and_then(|a| a.values().next()) {
            Some(index) => accessor::count(document, document.parse(index, "nodes", node)?)?.min(1),
            None => 0,
        },
    };
    if counts.iter().flatten().any(|&c| c != count) {
        let message = "has instance attributes of different lengths; export the file again";
        return Err(Error::invalid(document.place("nodes", node), message));
    }
    let mut transforms = vec![([0.0; 3], [0.0, 0.0, 0.0, 1.0], [1.0; 3]); count];
    for (to, from) in transforms.iter_mut().zip(translations.iter().flat_map(|a| a.rows(0.0))) {
        to.0 = from;
    }
    for (to, from) in transforms.iter_mut().zip(rotations.iter().flat_map(|a| a.rows(0.0))) {
        to.1 = from;
    }
    for (to, from) in transforms.iter_mut().zip(scales.iter().flat_map(|a| a.rows(0.0))) {
        to.2 = from;
    }
    Ok(transforms.into_iter().map(|(t, r, s)| trs(t, r, s)).collect())
}

/// The names from the root to entry `at`; of very deep ones only the last.
fn path(names: &[(String, Option<usize>)], at: usize) -> String {
    let mut parts = Vec::new();
    let mut next = Some(at);
    while let Some((name, parent)) = next.and_then(|i| names.get(i)) {
        if parts.len() == MAX_NAMES {
            parts.push("...");
            break;
        }
        parts.push(name.as_str());
        next = *parent;
    }
    parts.reverse();
    parts.join("/")
}

/// Makes repeated names unique by `#2`, `#3`, ...
#[derive(Default)]
struct UniqueNames {
    taken: HashSet<String>,
    /// The number tried last for a name.
    last: HashMap<String, usize>,
}

impl UniqueNames {
    fn make(&mut self, name: String) -> String {
        if self.taken.insert(name.clone()) {
            return name;
        }
        let last = self.last.entry(name.clone()).or_insert(1);
        loop {
            *last += 1;
            let candidate = format!("{name}#{last}");
            if self.taken.insert(candidate.clone()) {
                return candidate;
            }
        }
    }
}
