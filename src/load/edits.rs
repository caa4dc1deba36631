//! What settings change of a scene after it was read: roles of objects, looks of materials, strengths of lamps, each by a
//! pattern ([`super::pattern`]). Of several that match, later ones go before earlier ones, and all of
//! them before the file; factors multiply.
//!
//! The writers still work on the source: a glTF source keeps its materials and lights as they were.

mod lamps;

pub use lamps::{LampEdit, LampKind};

use super::pattern::{Pattern, near};
use crate::color::Rgb;
use crate::error::{Error, Result, Warnings};
use crate::scene::contribution::{BakeMode, Contribution, group_fault};
use crate::scene::{Environment, Material, RoleOpinion, Scene, SurfaceOrigin};
use lamps::{Lamp, skies};
use serde::{Deserialize, Serialize};
use std::collections::HashMap;

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
    /// Emission in place of the material's own and its texture, linear Rec.709 [nit; 0..1e9].
    pub emission: Option<[f32; 3]>,
    /// Factor on the emission [0..1e6].
    pub emission_scale: Option<f32>,
    /// Whether it reflects and shines on both sides.
    pub double_sided: Option<bool>,
    /// What of its emission's light is baked: all of it, or indirect light alone.
    pub bake: Option<BakeMode>,
    /// The light group of its emission.
    pub group: Option<String>,
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
                .or_else(|| fault("emission", m.emission.as_ref().map_or(&[][..], |e| &e[..]), 1e9))
                .or_else(|| fault("emission-scale", m.emission_scale.as_slice(), 1e6))
                .or_else(|| m.group.as_deref().and_then(group_fault))
                .or_else(|| (m.bake == Some(BakeMode::Dynamic)).then(|| NO_DYNAMIC_GLOW.into()));
            refuse("materials", &m.name, wrong)?;
        }
        self.lamps.iter().try_for_each(|l| refuse("lamps", &l.name, l.fault()))
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
            match edit.added() {
                Some(light) if scene.lights.iter().any(|other| other.name == light.name) => {
                    let message = "a light of this name is there already; add one of another name";
                    return Err(Error::invalid("lamps", format!("{}: {message}", light.name)));
                }
                Some(light) => scene.lights.push(light),
                None => {
                    let mut faults = Vec::new();
                    each(&edit.name, "lamps", lamps_of(scene), warnings, |(name, lamp)| {
                        faults.extend(edit.apply(lamp).map(|fault| (name, fault)));
                    })?;
                    faults.into_iter().for_each(|(name, fault)| warnings.add(name, fault));
                }
            }
        }
        let off = |name: &str| self.last(name, |edit| edit.enabled) == Some(false);
        for (_, (name, mut lamp)) in lamps_of(scene) {
            if off(&name) {
                lamp.each_strength(&|_| Rgb::ZERO);
            }
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

    /// What the last table about the lamp `name` says that says anything of it.
    fn last(&self, name: &str, of: impl Fn(&LampEdit) -> Option<bool>) -> Option<bool> {
        let holds = |edit: &LampEdit| match edit.add {
            Some(_) => edit.name == name,
            None => Pattern::new(&edit.name).is_ok_and(|pattern| pattern.holds(name)),
        };
        self.lamps.iter().rev().filter_map(|edit| Some((edit, of(edit)?))).find(|(edit, _)| holds(edit)).map(|(_, v)| v)
    }

    /// Takes out the lamps that are to be left out.
    fn remove_lamps(&self, scene: &mut Scene) {
        let is_skipped = |name: &str| self.last(name, |edit| edit.skip) == Some(true);
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

/// The lights and skies of `scene`, by name.
fn lamps_of(scene: &mut Scene) -> Vec<(String, (String, Lamp<'_>))> {
    let lights = scene.lights.iter_mut().map(|light| (light.name.clone(), Lamp::Light(light)));
    let all = lights.chain(scene.environment.iter_mut().flat_map(skies));
    all.map(|(name, lamp)| (name.clone(), (name, lamp))).collect()
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
    if let Some(emission) = edit.emission {
        (material.emission, material.emission_texture) = (emission.into(), None);
    }
    material.emission *= edit.emission_scale.unwrap_or(1.0);
    material.double_sided = edit.double_sided.unwrap_or(material.double_sided);
    let own = Contribution { mode: edit.bake, group: edit.group.as_deref().map(Into::into), shadow_mask: None };
    material.contribution = own.over(&material.contribution);
    // What is reflected doesn't pass.
    let left = (Rgb::ONE - material.albedo).max(Rgb::ZERO);
    material.transmission = material.transmission.min(left);
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
