//! How lights and skies shine that a scene has, and lights that are added to it: `[[lamps]]` in `lumel.toml`.

use crate::color::{Rgb, luminance};
use crate::load::units::{blackbody_rgb, exposure_scale};
use crate::scene::contribution::{BakeMode, Contribution, group_fault};
use crate::scene::{Environment, Light, LightShape, Picture};
use glam::{Affine3A, Mat3, Quat, Vec3};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Strength at most [cd, lx, nit], and places and sizes [m].
const MOST: f32 = 1e9;

/// Full angle of an added spot's cone and of an added sun's disc [degrees].
const SPOT_ANGLE: f32 = 90.0;
const SUN_ANGLE: f32 = 0.53;

/// How lights and skies of the scene shine, `[[lamps]]` in `lumel.toml`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub struct LampEdit {
    /// Pattern over the names of lights and skies; of a light that is added, its name.
    pub name: String,
    /// A light of this kind is added, of a strength of 1, white, at the origin, shining down, unless the table says otherwise.
    pub add: Option<LampKind>,
    /// Left out of the bake: it stays as it is for the engine to light with.
    pub skip: Option<bool>,
    /// False: it is off, and isn't left to the engine either.
    pub enabled: Option<bool>,
    /// Factor on its strength [0..1e6].
    pub scale: Option<f32>,
    /// Another factor, of 2 to this power [stops; -32..32].
    pub exposure: Option<f32>,
    /// The luminance of its strength in place of its own: cd of points and spots, lx at normal incidence of suns, nit of areas, and of
    /// skies, whose pictures it multiplies [0..1e9].
    pub intensity: Option<f32>,
    /// Its colour in place of its own, at the same luminance, linear Rec.709 [0..1e9].
    pub color: Option<[f32; 3]>,
    /// The same, as of a black body of this temperature [K; 1000..10000]; a colour that is given as well multiplies it.
    pub temperature: Option<f32>,
    /// Where its middle is [m, Y up].
    pub position: Option<[f32; 3]>,
    /// The way that it shines; any length.
    pub direction: Option<[f32; 3]>,
    /// Width and height of a rect that is added [m; default: 1, 1].
    pub size: Option<[f32; 2]>,
    /// Full angle of the cone of a spot that is added [degrees; default: 90], or of the disc of a sun [default: 0.53].
    pub angle: Option<f32>,
    /// What of its light is baked.
    pub bake: Option<BakeMode>,
    /// Its light group.
    pub group: Option<String>,
    /// Whether a shadow mask is made of it where masks are asked for.
    pub shadow_mask: Option<bool>,
}

/// Kinds of lights that can be added.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum LampKind {
    Point,
    Spot,
    Sun,
    Rect,
}

impl LampEdit {
    /// What it says of the lamp's part in the bake.
    pub(super) fn contribution(&self) -> Contribution {
        Contribution { mode: self.bake, group: self.group.as_deref().map(Into::into), shadow_mask: self.shadow_mask }
    }

    /// What is wrong with it.
    pub(super) fn fault(&self) -> Option<String> {
        let within = |name: &str, values: &[f32], low: f32, high: f32| {
            let wrong = values.iter().find(|v| !(low..=high).contains(*v))?;
            Some(format!("{name} {wrong} is out of range; allowed are {low} to {high}"))
        };
        let list = |values: &Option<[f32; 3]>| values.map_or(Vec::new(), |v| v.to_vec());
        let (color, direction) = (list(&self.color), list(&self.direction));
        let is_dark = |rgb: &[f32]| !rgb.is_empty() && rgb.iter().all(|v| *v == 0.0);
        let of_added = |is_given: bool, kinds: &[LampKind], fault: &str| {
            (is_given && !self.add.is_some_and(|kind| kinds.contains(&kind))).then(|| fault.to_string())
        };
        let is_pattern = self.name.is_empty() || self.name.contains(['*', '?']);
        within("scale", self.scale.as_slice(), 0.0, 1e6)
            .or_else(|| within("exposure", self.exposure.as_slice(), -32.0, 32.0))
            .or_else(|| within("intensity", self.intensity.as_slice(), 0.0, MOST))
            .or_else(|| within("color", &color, 0.0, MOST))
            .or_else(|| is_dark(&color).then(|| "color is black; enabled = false turns a lamp off".into()))
            .or_else(|| within("temperature", self.temperature.as_slice(), 1000.0, 10000.0))
            .or_else(|| within("position", &list(&self.position), -MOST, MOST))
            .or_else(|| within("direction", &direction, -MOST, MOST))
            .or_else(|| is_dark(&direction).then(|| "direction has no length".into()))
            .or_else(|| within("size", self.size.as_ref().map_or(&[], |s| &s[..]), 1e-6, MOST))
            .or_else(|| of_added(self.size.is_some(), &[LampKind::Rect], "size is for a light with add = \"rect\""))
            .or_else(|| within("angle", self.angle.as_slice(), 0.0, 180.0))
            .or_else(|| {
                let kinds = [LampKind::Spot, LampKind::Sun];
                of_added(self.angle.is_some(), &kinds, "angle is for a light with add = \"spot\" or \"sun\"")
            })
            .or_else(|| {
                (self.add.is_some() && is_pattern).then(|| "a light that is added needs a name of its own".into())
            })
            .or_else(|| self.group.as_deref().and_then(group_fault))
    }

    /// The light that is added.
    pub(super) fn added(&self) -> Option<Light> {
        let position = self.position.map_or(Vec3::ZERO, Vec3::from);
        let direction = self.direction.map_or(Vec3::NEG_Y, Vec3::from).normalize_or(Vec3::NEG_Y);
        let shape = match self.add? {
            LampKind::Point => LightShape::Point { position, intensity: Rgb::ONE, range: None },
            LampKind::Spot => {
                let outer = (self.angle.unwrap_or(SPOT_ANGLE) / 2.0).to_radians();
                LightShape::Spot { position, direction, intensity: Rgb::ONE, inner: 0.0, outer, range: None }
            }
            LampKind::Sun => {
                let angle = self.angle.unwrap_or(SUN_ANGLE).to_radians();
                LightShape::Directional { direction, illuminance: Rgb::ONE, angle }
            }
            LampKind::Rect => {
                // It shines along -(u x v), its width level.
                let right = direction.cross(Vec3::Y).try_normalize().unwrap_or(Vec3::X);
                let [width, height] = self.size.unwrap_or([1.0; 2]);
                let (u, v) = (right * (width / 2.0), right.cross(direction) * (height / 2.0));
                LightShape::Rect { center: position, u, v, radiance: Rgb::ONE }
            }
        };
        let mut light = Light::new(&self.name, shape);
        self.tune(&mut Lamp::Light(&mut light));
        Some(light)
    }

    /// Changes how `lamp` shines and its part in the bake; returns what can't be done.
    pub(super) fn apply(&self, mut lamp: Lamp) -> Option<&'static str> {
        self.tune(&mut lamp);
        let moves = self.position.is_some() || self.direction.is_some();
        let Lamp::Light(light) = lamp else {
            return moves.then_some("a sky is everywhere; its position and direction stay as they are");
        };
        if moves && matches!(&light.picture, Some(Picture::Thrown(projector)) if projector.focus.is_some()) {
            return Some("throws a picture that is sharp on a target, and stays where it is; move it in the scene");
        }
        if let Some(direction) = self.direction {
            turn(light, Vec3::from(direction).normalize_or(Vec3::NEG_Y));
        }
        match (self.position, light.position()) {
            (Some(to), Some(from)) => shift(light, Vec3::from(to) - from),
            (Some(_), None) => return Some("shines from infinitely far away and has no position"),
            (None, _) => {}
        }
        None
    }

    /// Changes strength and colour, and the part in the bake.
    fn tune(&self, lamp: &mut Lamp) {
        lamp.each_strength(&|strength| self.strength(strength));
        let contribution = lamp.contribution();
        *contribution = self.contribution().over(contribution);
    }

    /// The strength in place of `own`.
    fn strength(&self, own: Rgb) -> Rgb {
        let factor = self.scale.unwrap_or(1.0) * exposure_scale(self.exposure.unwrap_or(0.0));
        if self.intensity.is_none() && self.color.is_none() && self.temperature.is_none() {
            return own * factor;
        }
        let level = luminance(own);
        let tint = match (self.color, self.temperature) {
            (None, None) if level > 0.0 => own,
            (None, None) => Rgb::ONE,
            (color, kelvin) => color.map_or(Rgb::ONE, Rgb::from) * kelvin.map_or(Rgb::ONE, blackbody_rgb),
        };
        tint / luminance(tint) * (self.intensity.unwrap_or(level) * factor)
    }
}

/// Something that shines and is no surface.
pub(super) enum Lamp<'a> {
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

    /// Puts `new` of each strength that it has in its place.
    pub(super) fn each_strength(&mut self, new: &dyn Fn(Rgb) -> Rgb) {
        let change = |strength: &mut Rgb| *strength = new(*strength);
        match self {
            Self::Sky(radiance, _) => change(radiance),
            Self::Light(light) => match &mut light.shape {
                LightShape::Point { intensity, .. } | LightShape::Spot { intensity, .. } => change(intensity),
                LightShape::Directional { illuminance, .. } => change(illuminance),
                LightShape::Rect { radiance, .. }
                | LightShape::Disk { radiance, .. }
                | LightShape::Sphere { radiance, .. }
                | LightShape::Cylinder { radiance, .. } => change(radiance),
                LightShape::Portal { sky, .. } => {
                    let sky = Arc::make_mut(sky);
                    change(&mut sky.radiance);
                    sky.others.iter_mut().for_each(|other| change(&mut other.radiance));
                }
            },
        }
    }
}

/// A sky and the others, by name.
pub(super) fn skies(sky: &mut Environment) -> impl Iterator<Item = (String, Lamp<'_>)> {
    fn other(sky: &mut Environment) -> (String, Lamp<'_>) {
        let Environment { name, radiance, contribution, .. } = sky;
        (name.clone(), Lamp::Sky(radiance, contribution))
    }
    let Environment { name, radiance, contribution, others, .. } = sky;
    let first = (name.clone(), Lamp::Sky(radiance, contribution));
    std::iter::once(first).chain(others.iter_mut().map(other))
}

/// Turns a light about its middle, the shortest way, until it shines along `to` (unit).
fn turn(light: &mut Light, to: Vec3) {
    let from = (-light.world_from_light.z_axis).normalize_or(Vec3::NEG_Z);
    let turn = Mat3::from_quat(Quat::from_rotation_arc(from, to));
    light.world_from_light = turn * light.world_from_light;
    if let Some(shaping) = &mut light.shaping {
        shaping.axis = turn * shaping.axis;
    }
    if let Some(Picture::Thrown(projector)) = &mut light.picture {
        projector.picture_from_direction *= turn.transpose();
    }
    match &mut light.shape {
        LightShape::Point { .. } => {}
        LightShape::Spot { direction, .. } | LightShape::Directional { direction, .. } => *direction = to,
        LightShape::Rect { u, v, .. } | LightShape::Disk { u, v, .. } | LightShape::Portal { u, v, .. } => {
            (*u, *v) = (turn * *u, turn * *v);
        }
        LightShape::Sphere { world_from_unit, .. } | LightShape::Cylinder { world_from_unit, .. } => {
            let middle = world_from_unit.translation;
            *world_from_unit = Affine3A::from_mat3(turn) * *world_from_unit;
            world_from_unit.translation = middle;
        }
    }
}

/// Moves a light that has a place.
fn shift(light: &mut Light, by: Vec3) {
    match &mut light.shape {
        LightShape::Point { position, .. } | LightShape::Spot { position, .. } => *position += by,
        LightShape::Directional { .. } => {}
        LightShape::Rect { center, .. } | LightShape::Disk { center, .. } | LightShape::Portal { center, .. } => {
            *center += by;
        }
        LightShape::Sphere { world_from_unit, .. } | LightShape::Cylinder { world_from_unit, .. } => {
            world_from_unit.translation += glam::Vec3A::from(by);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn edit(toml: &str) -> LampEdit {
        toml::from_str(&format!("name = \"a\"\n{toml}")).unwrap()
    }

    fn shone(toml: &str, own: Rgb) -> Rgb {
        edit(toml).strength(own)
    }

    #[test]
    fn strength_and_colour_follow_the_table() {
        let own = Rgb::new(4.0, 2.0, 1.0);
        assert_eq!(shone("scale = 3.0\nexposure = 1.0", own), own * 6.0);
        let red = shone("color = [1.0, 0.0, 0.0]", own);
        assert!((luminance(red) - luminance(own)).abs() < 1e-5 && red.y == 0.0 && red.z == 0.0);
        let warm = shone("temperature = 2700.0\nintensity = 100.0", own);
        assert!((warm - blackbody_rgb(2700.0) * 100.0).abs().max_element() < 1e-3, "{warm}");
        assert_eq!(shone("intensity = 5.0", Rgb::ZERO), Rgb::splat(5.0) / luminance(Rgb::ONE));
        let level = shone("intensity = 7.0", own);
        assert!((luminance(level) - 7.0).abs() < 1e-5 && (level.x / level.z - 4.0).abs() < 1e-5);
    }

    #[test]
    fn what_makes_no_sense_is_told() {
        for (toml, word) in [
            ("color = [0.0, 0.0, 0.0]", "black"),
            ("temperature = 10.0", "out of range"),
            ("intensity = nan", "out of range"),
            ("direction = [0.0, 0.0, 0.0]", "length"),
            ("size = [1.0, 1.0]", "rect"),
            ("add = \"point\"\nangle = 3.0", "spot"),
        ] {
            assert!(edit(toml).fault().unwrap_or_default().contains(word), "{toml}: {:?}", edit(toml).fault());
        }
        assert!(LampEdit { name: "a*".into(), add: Some(LampKind::Sun), ..LampEdit::default() }.fault().is_some());
        assert_eq!(edit("add = \"rect\"\nsize = [2.0, 1.0]\nposition = [1.0, 2.0, 3.0]").fault(), None);
    }

    #[test]
    fn lights_are_made_moved_and_turned() {
        let rect = "add = \"rect\"\nposition = [1.0, 2.0, 3.0]\ndirection = [0.0, 0.0, -2.0]\nsize = [2.0, 1.0]";
        let mut light = edit(rect).added().unwrap();
        let normal = |light: &Light| match light.shape {
            LightShape::Rect { u, v, .. } => -u.cross(v),
            _ => panic!("no rect"),
        };
        assert!((normal(&light) - Vec3::new(0.0, 0.0, -0.5)).length() < 1e-6);
        let moved = edit("position = [0.0, 1.0, 0.0]\ndirection = [1.0, 0.0, 0.0]");
        assert_eq!(moved.apply(Lamp::Light(&mut light)), None);
        assert_eq!(light.position(), Some(Vec3::Y));
        assert!((normal(&light) - Vec3::new(0.5, 0.0, 0.0)).length() < 1e-6);
        let mut sun = edit("add = \"sun\"").added().unwrap();
        assert!(moved.apply(Lamp::Light(&mut sun)).is_some_and(|fault| fault.contains("no position")));
    }
}
