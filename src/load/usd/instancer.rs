//! Point instancers: each prototype is walked once, then placed for each point.

use super::walk::{MAX_SURFACES, Placed, State, Walk};
use super::{binding, read};
use crate::scene::SurfaceOrigin;
use glam::{DMat4, Quat, Vec3};
use openusd::sdf::{Path, Value};
use openusd::usd::Prim;
use std::collections::HashSet;

/// The arrays of an instancer.
struct Points {
    prototypes: Vec<i32>,
    positions: Vec<Vec3>,
    orientations: Vec<Quat>,
    scales: Vec<Vec3>,
    /// Points that are not drawn, by index.
    hidden: HashSet<usize>,
}

impl Walk {
    /// Places the prototypes of the point instancer `prim`.
    pub fn expand(&mut self, prim: &Prim, state: &State) {
        let path = prim.path();
        if self.expanding.contains(path) {
            self.warnings.add(path, "a point instancer is its own prototype; the inner one was left out");
            return;
        }
        let points = self.read_points(prim);
        let targets = prim.relationship("prototypes").forwarded_targets().unwrap_or_default();
        if targets.is_empty() || points.prototypes.is_empty() {
            self.warnings.add(path, "a point instancer without prototypes or points was left out");
            return;
        }
        self.expanding.push(path.clone());
        let prototypes: Vec<Vec<Placed>> = targets.iter().map(|target| self.record(target, state)).collect();
        self.expanding.pop();
        self.place(path, state, &points, &prototypes);
    }

    fn place(&mut self, path: &Path, state: &State, points: &Points, prototypes: &[Vec<Placed>]) {
        // The writers give each instance its rectangle in a primvar of the instancer, and the UVs to its prototypes. That
        // needs both to be prims that can hold opinions, and to be told apart by one index.
        let is_simple = self.expanding.is_empty() && state.instance.is_none();
        let name = path.as_str();
        let mut broken = 0usize;
        for (index, &prototype) in points.prototypes.iter().enumerate() {
            if points.hidden.contains(&index) {
                continue;
            }
            let prototype = usize::try_from(prototype).ok().and_then(|p| prototypes.get(p));
            let (Some(prototype), Some(&position)) = (prototype, points.positions.get(index)) else {
                broken += 1;
                continue;
            };
            let rotation = points.orientations.get(index).copied().unwrap_or(Quat::IDENTITY);
            let scale = points.scales.get(index).copied().unwrap_or(Vec3::ONE);
            let local =
                DMat4::from_scale_rotation_translation(scale.as_dvec3(), rotation.as_dquat(), position.as_dvec3());
            if self.surfaces.len() + prototype.len() > MAX_SURFACES {
                self.warnings.add(path, format!("surfaces beyond the first {MAX_SURFACES} were left out"));
                return;
            }
            for gprim in prototype {
                let origin = match gprim.origin {
                    SurfaceOrigin::UsdPrim if is_simple => {
                        SurfaceOrigin::UsdPoint { instancer: path.as_str().to_owned(), index, prim: gprim.prim.clone() }
                    }
                    _ => SurfaceOrigin::None,
                };
                if origin == SurfaceOrigin::None && self.expanding.is_empty() {
                    let message = "an instance within an instance has no prim of its own to hold a lightmap; it is \
                                   baked, but a USD layer can't say so";
                    self.warnings.add(&gprim.prim, message);
                }
                self.surfaces.push(Placed {
                    name: format!("{name}[{index}]{}", gprim.name),
                    prim: gprim.prim.clone(),
                    mesh: gprim.mesh,
                    world: state.world * local * gprim.world,
                    origin,
                    role: gprim.role,
                });
            }
        }
        if broken > 0 {
            self.warnings.add(format!("{path} ({broken})"), "points without a position or prototype were left out");
        }
    }

    /// The surfaces below `root`, in its parent's space and named from its parent.
    fn record(&mut self, root: &Path, state: &State) -> Vec<Placed> {
        let Ok(prim) = self.stage.prim(root.clone()) else { return Vec::new() };
        if !prim.is_valid().unwrap_or(false) || !prim.is_active().unwrap_or(false) {
            self.warnings.add(root, "a point instancer's prototype was not found");
            return Vec::new();
        }
        let mut inside = state.clone();
        inside.world = DMat4::IDENTITY;
        inside.bindings = binding::levels_above(&self.stage, root, &mut self.warnings);
        let outside = std::mem::take(&mut self.surfaces);
        self.enter(&prim, &inside);
        let mut recorded = std::mem::replace(&mut self.surfaces, outside);
        let above = root.parent().map_or(0, |p| if p.is_abs_root() { 0 } else { p.as_str().len() });
        for placed in &mut recorded {
            // Surfaces of a nested instancer are named by it, which lies below the root too.
            placed.name = placed.name.get(above..).unwrap_or_default().to_owned();
        }
        recorded
    }

    fn read_points(&mut self, prim: &Prim) -> Points {
        let w = &mut self.warnings;
        if w.time.is_some() && read::is_authored(prim, "velocities") {
            w.add(prim.path(), "velocities are not followed: positions between samples are interpolated");
        }
        let prototypes = read::value(prim, "protoIndices", w).and_then(read::to_ints).unwrap_or_default();
        let positions = read::value(prim, "positions", w).and_then(read::to_vec3s).unwrap_or_default();
        let mut rotations = |name: &str| read::value(prim, name, w).and_then(read::to_quats).filter(|q| !q.is_empty());
        let orientations = rotations("orientationsf").or_else(|| rotations("orientations")).unwrap_or_default();
        let scales = read::value(prim, "scales", w).and_then(read::to_vec3s).unwrap_or_default();
        let mut int64s = |name: &str| read::value(prim, name, w).and_then(read::to_int64s).unwrap_or_default();
        let ids = int64s("ids");
        let mut unseen: HashSet<i64> = int64s("invisibleIds").into_iter().collect();
        if let Ok(Some(Value::Int64ListOp(inactive))) = self.stage.field::<Value>(prim.path().clone(), "inactiveIds") {
            unseen.extend(inactive.flatten());
        }
        let id = |index: usize| ids.get(index).copied().unwrap_or(index as i64);
        let hidden = (0..prototypes.len()).filter(|&index| unseen.contains(&id(index))).collect();
        Points { prototypes, positions, orientations, scales, hidden }
    }
}
