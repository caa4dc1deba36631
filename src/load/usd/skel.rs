//! UsdSkel: meshes posed by skeletons and blend shapes.
//!
//! With the joints' transforms J in skeleton space, their bind transforms B and the mesh's geomBindTransform G, a point
//! becomes sum_i w_i J_i B_i^-1 G p in the skeleton's space (linear blend skinning; UsdSkel's schema text, "Skinning a
//! Point"), and from there goes back to the mesh's. Blend shapes add their offsets before. Normals follow the inverse
//! transpose of the blended matrix. Weights are used as they stand.
//!
//! Dual quaternion skinning is not done: such meshes are blended linearly, with a warning.

use super::geometry::Geometry;
use super::primvar::{Interpolation, Primvar};
use super::read::{self, Reading};
use super::xform;
use glam::{DMat3, DMat4, DVec3, Vec3};
use openusd::sdf::{Path, Value};
use openusd::tf::Token;
use openusd::usd::{Attribute, Prim, Stage};
use std::collections::HashMap;
use std::rc::Rc;

/// Skeletons that were read, by their prims' paths; `None` where one is broken.
#[derive(Default)]
pub struct Skeletons(HashMap<String, Option<Rc<Skeleton>>>);

/// A skeleton in its pose.
struct Skeleton {
    /// Index by joint.
    joints: HashMap<String, usize>,
    /// J B^-1 of each joint.
    transforms: Vec<DMat4>,
    /// Weights of blend shapes by their names.
    shapes: HashMap<String, f32>,
    stage_from_skeleton: DMat4,
}

/// Poses the points and normals of `geometry`, the mesh `prim` below a SkelRoot. What can't be posed stays in its rest pose,
/// with a warning.
pub fn pose(prim: &Prim, geometry: &mut Geometry, skeletons: &mut Skeletons, reading: &mut Reading) {
    let Some(path) = inherited_target(prim, "skel:skeleton") else { return };
    let Some(skeleton) = skeletons.read(prim.stage(), &path, reading) else { return };
    apply_shapes(prim, geometry, &skeleton, reading);
    let Some(influences) = Influences::read(prim, &skeleton, geometry.topology.points.len(), reading) else { return };
    let method = read::token(prim, "primvars:skel:skinningMethod", reading);
    if method.is_some_and(|method| method == "dualQuaternion") {
        reading.add(prim.path(), "dual quaternion skinning is not supported; the mesh is blended linearly");
    }
    let bind = read::value(prim, "primvars:skel:geomBindTransform", reading).and_then(to_matrix);
    let stage_from_mesh = stage_from(prim, reading);
    if stage_from_mesh.determinant() == 0.0 {
        reading.add(prim.path(), "the transform is not invertible; the mesh is taken in its rest pose");
        return;
    }
    let mesh_from_skeleton = stage_from_mesh.inverse() * skeleton.stage_from_skeleton;
    let blended: Vec<DMat4> = influences
        .blend(&skeleton.transforms)
        .map(|m| mesh_from_skeleton * m * bind.unwrap_or(DMat4::IDENTITY))
        .collect();
    let of_point = |point: usize| blended.get(if influences.is_rigid { 0 } else { point });
    turn_normals(geometry, |point| of_point(point).copied());
    for (i, point) in geometry.topology.points.iter_mut().enumerate() {
        if let Some(m) = of_point(i) {
            *point = m.transform_point3(point.as_dvec3()).as_vec3();
        }
    }
}

fn to_matrix(value: Value) -> Option<DMat4> {
    match value {
        Value::Matrix4d(m) => Some(read::to_matrix(&m)),
        _ => None,
    }
}

fn matrices(prim: &Prim, name: &str, reading: &mut Reading) -> Vec<DMat4> {
    match read::value(prim, name, reading) {
        Some(Value::Matrix4dVec(matrices)) => matrices.iter().map(read::to_matrix).collect(),
        _ => Vec::new(),
    }
}

fn tokens(prim: &Prim, name: &str, reading: &mut Reading) -> Vec<String> {
    match read::value(prim, name, reading) {
        Some(Value::TokenVec(names)) => names.iter().map(|n| n.as_str().to_owned()).collect(),
        Some(Value::StringVec(names)) => names,
        _ => Vec::new(),
    }
}

/// The closest prim at or above `prim` for which `find` finds something.
fn closest<T>(prim: &Prim, find: impl Fn(&Prim) -> Option<T>) -> Option<T> {
    let mut at = Some(prim.clone());
    while let Some(prim) = at.filter(|prim| !prim.path().is_abs_root()) {
        if let Some(found) = find(&prim) {
            return Some(found);
        }
        at = prim.parent();
    }
    None
}

/// The target of the relationship `name`, inherited down the namespace as UsdSkel's bindings are.
fn inherited_target(prim: &Prim, name: &str) -> Option<Path> {
    closest(prim, |prim| {
        let relationship = prim.relationship(name);
        // An empty list of targets says that there is none.
        let is_said = relationship.has_authored_targets().unwrap_or(false);
        is_said.then(|| relationship.forwarded_targets().unwrap_or_default().into_iter().next())
    })
    .flatten()
}

/// The transform from the space of `prim` to the stage's.
fn stage_from(prim: &Prim, reading: &mut Reading) -> DMat4 {
    let mut whole = DMat4::IDENTITY;
    let mut at = Some(prim.clone());
    while let Some(prim) = at.filter(|prim| !prim.path().is_abs_root()) {
        let local = xform::local_xform(&prim, reading);
        whole = local.parent_from_local * whole;
        if local.resets {
            break;
        }
        at = prim.parent();
    }
    whole
}

impl Skeletons {
    fn read(&mut self, stage: &Stage, path: &Path, reading: &mut Reading) -> Option<Rc<Skeleton>> {
        if let Some(known) = self.0.get(path.as_str()) {
            return known.clone();
        }
        let prim = stage.prim(path.clone()).ok().filter(|prim| prim.is_valid().unwrap_or(false));
        let skeleton = match prim {
            Some(prim) => Skeleton::read(&prim, reading).map(Rc::new),
            None => {
                reading.add(path, "a bound skeleton was not found; its meshes are taken in their rest pose");
                None
            }
        };
        self.0.insert(path.as_str().to_owned(), skeleton.clone());
        skeleton
    }
}

impl Skeleton {
    fn read(prim: &Prim, reading: &mut Reading) -> Option<Self> {
        let joints = tokens(prim, "joints", reading);
        let binds = matrices(prim, "bindTransforms", reading);
        if binds.len() != joints.len() {
            let message = "a skeleton whose bindTransforms are not as many as its joints was left out; its meshes are \
                           taken in their rest pose";
            reading.add(prim.path(), message);
            return None;
        }
        let animation = inherited_target(prim, "skel:animationSource");
        let animation =
            animation.and_then(|path| prim.stage().prim(path).ok()).filter(|a| a.is_valid().unwrap_or(false));
        let moved = animation.as_ref().and_then(|a| animated_joints(a, reading)).unwrap_or_default();
        let rests = matrices(prim, "restTransforms", reading);
        if rests.len() != joints.len() && joints.iter().any(|joint| !moved.contains_key(joint)) {
            reading.add(prim.path(), "joints without a rest transform or an animation are taken as unmoved");
        }
        let locals: Vec<DMat4> = joints
            .iter()
            .enumerate()
            .map(|(i, joint)| moved.get(joint).or(rests.get(i)).copied().unwrap_or(DMat4::IDENTITY))
            .collect();
        let has_pose = !moved.is_empty() || rests.len() == joints.len();
        let transforms = match has_pose {
            true => skeleton_space(&joints, &locals)
                .iter()
                .zip(&binds)
                .map(|(joint, bind)| *joint * inverse(bind))
                .collect(),
            false => vec![DMat4::IDENTITY; joints.len()],
        };
        let shapes = animation.map(|a| animated_shapes(&a, reading)).unwrap_or_default();
        let joints = joints.into_iter().enumerate().map(|(i, joint)| (joint, i)).collect();
        Some(Self { joints, transforms, shapes, stage_from_skeleton: stage_from(prim, reading) })
    }
}

fn inverse(m: &DMat4) -> DMat4 {
    if m.determinant() == 0.0 { DMat4::IDENTITY } else { m.inverse() }
}

/// Joints' transforms in the skeleton's space from those relative to their parents: the closest joints by path.
fn skeleton_space(joints: &[String], locals: &[DMat4]) -> Vec<DMat4> {
    let number: HashMap<&str, usize> = joints.iter().enumerate().map(|(i, joint)| (joint.as_str(), i)).collect();
    // A parent's path is shorter.
    let mut order: Vec<usize> = (0..joints.len()).collect();
    order.sort_by_key(|&i| joints[i].len());
    let mut whole = locals.to_vec();
    for i in order {
        let ends = joints[i].match_indices('/').map(|(end, _)| end);
        if let Some(&parent) = ends.rev().find_map(|end| number.get(&joints[i][..end])) {
            whole[i] = whole[parent] * locals[i];
        }
    }
    whole
}

/// The local transforms of the joints that the SkelAnimation `prim` moves, by joint.
fn animated_joints(prim: &Prim, reading: &mut Reading) -> Option<HashMap<String, DMat4>> {
    let joints = tokens(prim, "joints", reading);
    if joints.is_empty() {
        return None;
    }
    let translations = read::value(prim, "translations", reading).and_then(read::to_vec3s).unwrap_or_default();
    let rotations = read::value(prim, "rotations", reading).and_then(read::to_quats).unwrap_or_default();
    let scales = read::value(prim, "scales", reading).and_then(read::to_vec3s).unwrap_or_default();
    if [translations.len(), rotations.len(), scales.len()] != [joints.len(); 3] {
        let message = "an animation whose translations, rotations and scales are not as many as its joints was left out; \
                       its skeletons rest";
        reading.add(prim.path(), message);
        return None;
    }
    let parts = translations.iter().zip(&rotations).zip(&scales);
    let transforms =
        parts.map(|((t, r), s)| DMat4::from_scale_rotation_translation(s.as_dvec3(), r.as_dquat(), t.as_dvec3()));
    Some(joints.into_iter().zip(transforms).collect())
}

fn animated_shapes(prim: &Prim, reading: &mut Reading) -> HashMap<String, f32> {
    let names = tokens(prim, "blendShapes", reading);
    let weights = read::value(prim, "blendShapeWeights", reading).and_then(read::to_floats).unwrap_or_default();
    if names.len() != weights.len() {
        reading.add(prim.path(), "blend shapes and their weights are not equally many; they were left out");
        return HashMap::new();
    }
    names.into_iter().zip(weights).collect()
}

/// Which joints move a mesh.
struct Influences {
    /// (index into the skeleton's joints, weight), `width` of them a point; `None`: no joint of the skeleton.
    entries: Vec<(Option<usize>, f32)>,
    width: usize,
    /// One set for the whole mesh.
    is_rigid: bool,
}

impl Influences {
    /// `None` where no joint moves the mesh, or, with a warning, where the influences don't fit it.
    fn read(prim: &Prim, skeleton: &Skeleton, points: usize, reading: &mut Reading) -> Option<Self> {
        let attribute = |name: &str| -> Option<Attribute> {
            closest(prim, |prim| read::is_authored(prim, name).then(|| prim.attribute(name)))
        };
        let (indices, weights) = (attribute("primvars:skel:jointIndices")?, attribute("primvars:skel:jointWeights")?);
        let width = indices.get_metadata::<i32>("elementSize").ok().flatten().unwrap_or(1);
        let interpolation = indices.get_metadata::<Token>("interpolation").ok().flatten();
        let is_rigid = interpolation.is_none_or(|i| i.as_str() == "constant");
        let indices = read::attribute_value(&indices, reading).and_then(read::to_ints)?;
        let weights = read::attribute_value(&weights, reading).and_then(read::to_floats)?;
        let own = tokens(prim, "skel:joints", reading);
        let known = |index: i32| {
            let index = usize::try_from(index).ok()?;
            match own.is_empty() {
                true => (index < skeleton.transforms.len()).then_some(index),
                false => skeleton.joints.get(own.get(index)?).copied(),
            }
        };
        let width = usize::try_from(width).ok().filter(|&n| n > 0)?;
        let elements = if is_rigid { 1 } else { points };
        let fits = elements.checked_mul(width).is_some_and(|n| indices.len() == n && weights.len() == n);
        if !fits {
            reading.add(prim.path(), "joint influences don't fit the mesh's points; it is taken in its rest pose");
            return None;
        }
        let entries: Vec<_> = indices.into_iter().map(known).zip(weights).collect();
        if entries.iter().any(|(joint, weight)| joint.is_none() && *weight != 0.0) {
            reading.add(prim.path(), "joint influences name joints that the skeleton lacks; they count as unmoved");
        }
        Some(Self { entries, width, is_rigid })
    }

    /// The weighed sum of joint transforms of each point.
    fn blend<'a>(&'a self, transforms: &'a [DMat4]) -> impl Iterator<Item = DMat4> + 'a {
        self.entries.chunks_exact(self.width).map(|entries| {
            entries.iter().filter(|(_, weight)| *weight != 0.0).fold(DMat4::ZERO, |sum, &(joint, weight)| {
                let transform = joint.and_then(|j| transforms.get(j)).copied().unwrap_or(DMat4::IDENTITY);
                sum + transform * f64::from(weight)
            })
        })
    }
}

/// Turns authored normals by the matrix of their point.
fn turn_normals(geometry: &mut Geometry, of_point: impl Fn(usize) -> Option<DMat4>) {
    let Some(normals) = &geometry.attributes.normals else { return };
    let turned = |normal: Vec3, point: usize| {
        let Some(m) = of_point(point) else { return normal };
        let linear = DMat3::from_mat4(m);
        // Times the determinant: the direction is the same, and a flat matrix has one too.
        let cofactors = DMat3::from_cols(
            linear.y_axis.cross(linear.z_axis),
            linear.z_axis.cross(linear.x_axis),
            linear.x_axis.cross(linear.y_axis),
        );
        (cofactors * normal.as_dvec3()).try_normalize().map_or(normal, DVec3::as_vec3)
    };
    let value = |element: usize| normals.values().get(normals.number(element)?).copied();
    let indices = &geometry.topology.indices;
    let (values, interpolation): (Option<Vec<Vec3>>, _) = match normals.interpolation {
        Interpolation::Vertex | Interpolation::Varying => {
            let points = 0..geometry.topology.points.len();
            (points.map(|i| Some(turned(value(i)?, i))).collect(), normals.interpolation)
        }
        Interpolation::FaceVarying => {
            let corners = indices.iter().enumerate();
            let turned = |(corner, &point)| Some(turned(value(corner)?, usize::try_from(point).ok()?));
            (corners.map(turned).collect(), Interpolation::FaceVarying)
        }
        // One normal for many points can't follow them.
        Interpolation::Constant | Interpolation::Uniform => (None, normals.interpolation),
    };
    geometry.attributes.normals = values.map(|values| Primvar::new(values, interpolation));
}

/// A blend shape's offsets at one weight.
struct Shape {
    weight: f32,
    offsets: Vec<Vec3>,
}

/// Adds the offsets of the mesh's blend shapes.
fn apply_shapes(prim: &Prim, geometry: &mut Geometry, skeleton: &Skeleton, reading: &mut Reading) {
    let names = tokens(prim, "skel:blendShapes", reading);
    let targets = prim.relationship("skel:blendShapeTargets").forwarded_targets().unwrap_or_default();
    if names.len() != targets.len() {
        reading.add(prim.path(), "blend shapes and their targets are not equally many; they were left out");
        return;
    }
    let mut moved = false;
    for (name, target) in names.iter().zip(targets) {
        let Some(&weight) = skeleton.shapes.get(name).filter(|w| **w != 0.0 && w.is_finite()) else { continue };
        let Ok(shape) = prim.stage().prim(target) else { continue };
        let points = read::value(&shape, "pointIndices", reading).and_then(read::to_ints);
        let mut outside = 0usize;
        for (share, offsets) in shares(steps(&shape, reading), weight) {
            for (i, offset) in offsets.iter().enumerate() {
                let point = match &points {
                    Some(points) => points.get(i).and_then(|&p| usize::try_from(p).ok()),
                    None => Some(i),
                };
                match point.and_then(|p| geometry.topology.points.get_mut(p)) {
                    Some(point) => *point += share * *offset,
                    None => outside += 1,
                }
            }
            moved = true;
        }
        if outside > 0 {
            reading
                .add(format!("{} ({outside})", shape.path()), "offsets of a blend shape at points that are not there");
        }
    }
    if moved && geometry.attributes.normals.take().is_some() {
        reading
            .add(prim.path(), "the authored normals of a mesh with blend shapes don't hold; its faces' own are used");
    }
}

/// The shape of the BlendShape `prim` and its inbetweens, by rising weight.
fn steps(prim: &Prim, reading: &mut Reading) -> Vec<Shape> {
    let vectors = |name: &str, reading: &mut Reading| read::value(prim, name, reading).and_then(read::to_vec3s);
    let mut steps = vec![
        Shape { weight: 0.0, offsets: Vec::new() },
        Shape { weight: 1.0, offsets: vectors("offsets", reading).unwrap_or_default() },
    ];
    for name in prim.authored_property_names().unwrap_or_default() {
        let is_inbetween = name.strip_prefix("inbetweens:").is_some_and(|rest| !rest.contains(':'));
        let attribute = prim.attribute(name.as_str());
        let weight = attribute.get_metadata::<Value>("weight").ok().flatten().and_then(read::to_float);
        if let (true, Some(weight)) = (is_inbetween, weight.filter(|w| w.is_finite() && *w != 0.0 && *w != 1.0)) {
            steps.push(Shape { weight, offsets: vectors(name.as_str(), reading).unwrap_or_default() });
        }
    }
    steps.sort_by(|a, b| a.weight.total_cmp(&b.weight));
    steps
}

/// What the two steps around `weight` count: the line through them, beyond the ends too.
fn shares(steps: Vec<Shape>, weight: f32) -> Vec<(f32, Vec<Vec3>)> {
    let above = steps.iter().position(|s| s.weight > weight).unwrap_or(steps.len() - 1).max(1);
    let [from, to] = [steps[above - 1].weight, steps[above].weight];
    let share = if to > from { (weight - from) / (to - from) } else { 1.0 };
    let mut steps = steps.into_iter().skip(above - 1);
    [1.0 - share, share].into_iter().filter_map(|share| Some((share, steps.next()?.offsets))).collect()
}
