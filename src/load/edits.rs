//! What settings change of a scene after it was read: roles of objects, looks of materials, strengths of lamps, each by a
//! pattern ([`super::pattern`]). Of several that match, later ones go before earlier ones, and all of
//! them before the file; factors multiply.
//!
//! The writers still work on the source: a glTF source keeps its materials and lights as they were.

use super::pattern::{Pattern, near};
use crate::color::Rgb;
use crate::error::{Error, Result, Warnings};
use crate::scene::contribution::{BakeMode, Contribution, group_fault};
use crate::scene::{Environment, Light, LightShape, Material, RoleOpinion, Scene, SurfaceOrigin};
use serde::{Deserialize, Serialize};
use std::collections::HashMap;
use std::sync::Arc;

/// What to say of a material that is asked to be left out.
const NO_DYNAMIC_GLOW: &str = "a glow is part of its surface: baked or indirect, but not dynamic";

/// Changes to a scene.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Edits {
    pub objects: Vec<ObjectEdit>,
    pub materials: Vec<MaterialEdit>,
    pub lamps: Vec<LampEdit>,
}

/// What objects do in the bake, `[[objects]]` in `lumel.toml`: see [`crate::scene::role`].
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub struct ObjectEdit {
    /// Pattern over the paths of surfaces.
    pub path: String,
    pub skip: Option<bool>,
    pub casts: Option<bool>,
    pub receives: Option<bool>,
    pub lightmapped: Option<bool>,
    /// Texels per metre [0.0001..100000].
    pub density: Option<f32>,
    /// Factor on the density [0.001..1000].
    pub density_scale: Option<f32>,
}

/// What materials are taken to be, `[[materials]]` in `lumel.toml`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub struct MaterialEdit {
    /// Pattern over the names of materials.
    pub name: String,
    /// Diffuse albedo in place of the material's own and its texture, linear Rec.709 [0..1]; vertex colours still multiply
    /// it.
    pub albedo: Option<[f32; 3]>,
    /// Factor on the albedo [0..100].
    pub albedo_scale: Option<f32>,
    /// Factor on the emission [0..1e6].
    pub emission_scale: Option<f32>,
    /// Whether it reflects and shines on both sides.
    pub double_sided: Option<bool>,
    /// What of its emission's light is baked: all of it, or indirect light alone.
    pub bake: Option<BakeMode>,
    /// The light group of its emission.
    pub group: Option<String>,
}

/// How lights and skies of the scene shine, `[[lamps]]` in `lumel.toml`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub struct LampEdit {
    /// Pattern over the names of lights and skies.
    pub name: String,
    /// Left out of the bake: it stays as it is for the engine to light with.
    pub skip: Option<bool>,
    /// Factor on its strength [0..1e6].
    pub scale: Option<f32>,
    /// What of its light is baked.
    pub bake: Option<BakeMode>,
    /// Its light group.
    pub group: Option<String>,
    /// Whether a shadow mask is made of it where masks are asked for.
    pub shadow_mask: Option<bool>,
}

impl LampEdit {
    fn contribution(&self) -> Contribution {
        Contribution { mode: self.bake, group: self.group.as_deref().map(Into::into), shadow_mask: self.shadow_mask }
    }
}

impl ObjectEdit {
    fn opinion(&self) -> RoleOpinion {
        let Self { skip, casts, receives, lightmapped, density, density_scale, .. } = *self;
        RoleOpinion { skip, casts, receives, lightmapped, density, density_scale }
    }
}

impl Edits {
    /// Refuses numbers out of range and empty patterns.
    ///
    /// # Errors
    /// `Invalid`, naming the table and the pattern in it.
    pub fn check(&self) -> Result<()> {
        let refuse = |table: &str, pattern: &str, fault: Option<String>| match fault {
            Some(fault) => Err(Error::invalid(table, format!("{pattern}: {fault}"))),
            None => Pattern::new(pattern).map(drop).map_err(|e| Error::invalid(table, e)),
        };
        let fault = |name: &str, values: &[f32], most: f32| {
            let wrong = values.iter().find(|v| !(0.0..=most).contains(*v))?;
            Some(format!("{name} {wrong} is out of range; allowed are 0 to {most}"))
        };
        self.objects.iter().try_for_each(|o| refuse("objects", &o.path, o.opinion().fault()))?;
        for m in &self.materials {
            let albedo = m.albedo.as_ref().map_or(&[][..], |a| &a[..]);
            let wrong = fault("albedo", albedo, 1.0)
                .or_else(|| fault("albedo-scale", m.albedo_scale.as_slice(), 100.0))
                .or_else(|| fault("emission-scale", m.emission_scale.as_slice(), 1e6))
                .or_else(|| m.group.as_deref().and_then(group_fault))
                .or_else(|| (m.bake == Some(BakeMode::Dynamic)).then(|| NO_DYNAMIC_GLOW.into()));
            refuse("materials", &m.name, wrong)?;
        }
        self.lamps.iter().try_for_each(|l| {
            let wrong = fault("scale", l.scale.as_slice(), 1e6).or_else(|| l.group.as_deref().and_then(group_fault));
            refuse("lamps", &l.name, wrong)
        })
    }

    /// Changes `scene`, and removes the surfaces that are to be left out; `place` names the file.
    ///
    /// # Errors
    /// `Invalid` where a pattern or number is wrong, or nothing is left to bake.
    pub fn apply(&self, scene: &mut Scene, place: &str, warnings: &mut Warnings) -> Result<()> {
        self.check()?;
        for edit in &self.objects {
            let of = scene.surfaces.iter_mut().map(|s| (s.name.clone(), &mut s.role));
            each(&edit.path, "objects", of.collect(), warnings, |role| *role = edit.opinion().apply(*role))?;
        }
        for edit in &self.materials {
            let of = scene.materials.iter_mut().map(|m| (m.name.clone(), m));
            each(&edit.name, "materials", of.collect(), warnings, |material| change(material, edit))?;
        }
        for edit in &self.lamps {
            let scale = edit.scale.unwrap_or(1.0);
            let mut lamps: Vec<(String, Lamp)> =
                scene.lights.iter_mut().map(|l| (l.name.clone(), Lamp::Light(l))).collect();
            if let Some(sky) = &mut scene.environment {
                lamps.extend(skies(sky));
            }
            let own = edit.contribution();
            each(&edit.name, "lamps", lamps, warnings, |mut lamp| {
                lamp.scale(scale);
                let contribution = lamp.contribution();
                *contribution = own.over(contribution);
            })?;
        }
        for material in scene.materials.iter_mut().filter(|m| m.contribution.mode() == BakeMode::Dynamic) {
            warnings.add(&material.name, format!("{NO_DYNAMIC_GLOW}; it is baked"));
            material.contribution.mode = None;
        }
        remove_skipped(scene, place)?;
        self.remove_lamps(scene);
        split_meshes(scene);
        Ok(())
    }

    /// Takes out the lamps that are to be left out.
    fn remove_lamps(&self, scene: &mut Scene) {
        let patterns: Vec<(Pattern, bool)> =
            self.lamps.iter().filter_map(|l| Some((Pattern::new(&l.name).ok()?, l.skip?))).collect();
        let is_skipped = |name: &str| patterns.iter().rev().find(|(p, _)| p.holds(name)).is_some_and(|(_, skip)| *skip);
        scene.lights.retain(|light| !is_skipped(&light.name));
        let Some(mut sky) = scene.environment.take() else { return };
        sky.others.retain(|other| !is_skipped(&other.name));
        scene.environment = if is_skipped(&sky.name) {
            // The next one leads the others.
            let mut others = std::mem::take(&mut sky.others).into_iter();
            others.next().map(|first| Environment { others: others.collect(), ..first })
        } else {
            Some(sky)
        };
    }
}

/// Calls `change` for all that the pattern holds for; that it is for nothing is a warning.
fn each<T>(
    pattern: &str,
    table: &str,
    items: Vec<(String, T)>,
    warnings: &mut Warnings,
    mut change: impl FnMut(T),
) -> Result<()> {
    let parsed = Pattern::new(pattern).map_err(|e| Error::invalid(table, e))?;
    let (mut found, mut others) = (false, Vec::new());
    for (name, item) in items {
        if parsed.holds(&name) {
            change(item);
            found = true;
        } else {
            others.push(name);
        }
    }
    if !found {
        let near = near(pattern, others.iter().map(String::as_str));
        warnings.add(pattern, format!("a pattern of [[{table}]] matches nothing; {near}"));
    }
    Ok(())
}

fn change(material: &mut Material, edit: &MaterialEdit) {
    if let Some(albedo) = edit.albedo {
        material.albedo = albedo.into();
        material.albedo_texture = None;
    }
    material.albedo *= edit.albedo_scale.unwrap_or(1.0);
    if let Some(look) = &mut material.appearance {
        if let Some(albedo) = edit.albedo {
            (look.base_color, look.base_color_texture) = (albedo.into(), None);
        }
        look.base_color *= edit.albedo_scale.unwrap_or(1.0);
    }
    material.emission *= edit.emission_scale.unwrap_or(1.0);
    material.double_sided = edit.double_sided.unwrap_or(material.double_sided);
    let own = Contribution { mode: edit.bake, group: edit.group.as_deref().map(Into::into), shadow_mask: None };
    material.contribution = own.over(&material.contribution);
    // What is reflected doesn't pass.
    let left = (Rgb::ONE - material.albedo).max(Rgb::ZERO);
    material.transmission = material.transmission.min(left);
}

/// Something that shines and is no surface.
enum Lamp<'a> {
    Light(&'a mut Light),
    Sky(&'a mut Rgb, &'a mut Contribution),
}

impl Lamp<'_> {
    fn contribution(&mut self) -> &mut Contribution {
        match self {
            Self::Light(light) => &mut light.contribution,
            Self::Sky(_, contribution) => contribution,
        }
    }

    fn scale(&mut self, by: f32) {
        match self {
            Self::Sky(radiance, _) => **radiance *= by,
            Self::Light(light) => match &mut light.shape {
                LightShape::Point { intensity, .. } | LightShape::Spot { intensity, .. } => *intensity *= by,
                LightShape::Directional { illuminance, .. } => *illuminance *= by,
                LightShape::Rect { radiance, .. }
                | LightShape::Disk { radiance, .. }
                | LightShape::Sphere { radiance, .. }
                | LightShape::Cylinder { radiance, .. } => *radiance *= by,
                LightShape::Portal { sky, .. } => {
                    let sky = Arc::make_mut(sky);
                    sky.radiance *= by;
                    sky.others.iter_mut().for_each(|other| other.radiance *= by);
                }
            },
        }
    }
}

/// A sky and the others, by name.
fn skies(sky: &mut Environment) -> impl Iterator<Item = (String, Lamp<'_>)> {
    fn other(sky: &mut Environment) -> (String, Lamp<'_>) {
        let Environment { name, radiance, contribution, .. } = sky;
        (name.clone(), Lamp::Sky(radiance, contribution))
    }
    let Environment { name, radiance, contribution, others, .. } = sky;
    let first = (name.clone(), Lamp::Sky(radiance, contribution));
    std::iter::once(first).chain(others.iter_mut().map(other))
}

/// Removes the surfaces that are to be left out.
fn remove_skipped(scene: &mut Scene, place: &str) -> Result<()> {
    let keep: Vec<bool> = scene.surfaces.iter().map(|s| !s.role.skip).collect();
    if !keep.is_empty() && !keep.contains(&true) {
        let message = "every surface is left out of the bake (skip); leave some in";
        return Err(Error::invalid(place, message));
    }
    if keep.contains(&false) {
        scene.retain_surfaces(&keep);
    }
    Ok(())
}

/// Gives glTF nodes that share a mesh but not its density meshes of their own: UVs belong to a mesh. USD's instances can't
/// have other UVs than their prototype.
fn split_meshes(scene: &mut Scene) {
    let mut of_node = HashMap::new();
    // By mesh: the first density, which keeps it.
    let mut first = HashMap::new();
    let mut copies = HashMap::new();
    for s in 0..scene.surfaces.len() {
        let surface = &scene.surfaces[s];
        let SurfaceOrigin::GltfNode(node) = surface.origin else { continue };
        let role = &surface.role;
        let own = (role.density.map(f32::to_bits), role.density_scale.to_bits());
        // A node's GPU instances draw one mesh.
        let density = *of_node.entry(node).or_insert(own);
        let mesh = surface.mesh;
        if *first.entry(mesh).or_insert(density) == density {
            continue;
        }
        let copy = *copies.entry((mesh, density)).or_insert_with(|| {
            scene.meshes.push(scene.meshes[mesh].clone());
            scene.meshes.len() - 1
        });
        scene.surfaces[s].mesh = copy;
    }
}
