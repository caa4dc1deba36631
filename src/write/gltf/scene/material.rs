//! Diffuse materials of the scene to glTF: metallic 0, roughness 1, textures embedded, emission in nit by
//! KHR_materials_emissive_strength.

use super::super::document::{Document, Object, number};
use super::super::viewer_colors::{UNLIT, white};
use super::mesh::array;
use super::picture::{Encoding, Pictures};
use super::uv_sets;
use crate::color::Rgb;
use crate::error::{Result, Warnings};
use crate::scene::{Alpha, Scene, TextureSlot, Wrap};
use glam::{Affine2, Vec4};
use serde_json::{Value, json};
use std::collections::BTreeMap;

/// Writes materials on first use, each once.
pub struct Materials<'a> {
    scene: &'a Scene,
    /// The set that lightmap UVs take; `None` for materials without lighting, to be shown with baked colours.
    lightmap_set: Option<usize>,
    written: BTreeMap<(usize, bool), usize>,
    pictures: Pictures,
}

impl<'a> Materials<'a> {
    pub fn new(scene: &'a Scene, lightmap_set: Option<usize>) -> Self {
        Self { scene, lightmap_set, written: BTreeMap::new(), pictures: Pictures::default() }
    }

    /// Numbers and names of the UV sets that material `material` uses: they go around the lightmap's.
    pub fn sets(&self, material: usize) -> Vec<(usize, String)> {
        let number = |i: usize| if self.lightmap_set.is_some_and(|l| i >= l) { i + 1 } else { i };
        let sets = uv_sets(&self.scene.materials[material]);
        sets.into_iter().enumerate().map(|(i, name)| (number(i), name.to_string())).collect()
    }

    /// The document's index of material `material`; `whole`: white, for colours that are all that leaves a surface.
    ///
    /// # Errors
    /// `Invalid` where a picture can't be encoded.
    pub fn write(
        &mut self,
        doc: &mut Document,
        material: usize,
        whole: bool,
        warnings: &mut Warnings,
    ) -> Result<usize> {
        if let Some(written) = self.written.get(&(material, whole)) {
            return Ok(*written);
        }
        let source = &self.scene.materials[material];
        let mut json = json!({ "name": source.name });
        if source.double_sided {
            json["doubleSided"] = true.into();
        }
        let opacity = match source.alpha {
            Alpha::Opaque => 1.0,
            Alpha::Mask { cutoff, opacity } => {
                json["alphaMode"] = "MASK".into();
                json["alphaCutoff"] = number(cutoff);
                opacity
            }
            Alpha::Blend { opacity } => {
                json["alphaMode"] = "BLEND".into();
                opacity
            }
        };
        let (factor, texture) = self.albedo(doc, material, opacity.clamp(0.0, 1.0), warnings)?;
        json["pbrMetallicRoughness"] =
            json!({ "baseColorFactor": array(factor.to_array()), "metallicFactor": 0.0, "roughnessFactor": 1.0 });
        if let Some(texture) = texture {
            json["pbrMetallicRoughness"]["baseColorTexture"] = texture;
        }
        if whole {
            json = white(json.as_object());
            doc.use_extension(UNLIT);
        } else if self.lightmap_set.is_none() {
            json["extensions"] = json!({ UNLIT: {} });
            doc.use_extension(UNLIT);
        } else if source.is_emissive() {
            self.emission(doc, material, &mut json, warnings)?;
        }
        let index = doc.push("materials", json);
        self.written.insert((material, whole), index);
        Ok(index)
    }

    /// Base colour factor and texture.
    fn albedo(
        &mut self,
        doc: &mut Document,
        material: usize,
        opacity: f32,
        warnings: &mut Warnings,
    ) -> Result<(Vec4, Option<Value>)> {
        let source = &self.scene.materials[material];
        let factor = source.albedo.extend(opacity);
        let Some(slot) = &source.albedo_texture else {
            return Ok((factor.clamp(Vec4::ZERO, Vec4::ONE), None));
        };
        // A plain scale that a factor can take goes into it, and the picture stays as it is.
        let scaled = factor * slot.scale;
        let as_it_is = slot.bias == Vec4::ZERO && scaled.cmpge(Vec4::ZERO).all() && scaled.cmple(Vec4::ONE).all();
        let values = if as_it_is { (Vec4::ONE, Vec4::ZERO) } else { (slot.scale, slot.bias) };
        let encoding = Encoding { scale: values.0, bias: values.1, peak: 1.0, alpha: source.alpha != Alpha::Opaque };
        let texture = self.texture(doc, material, slot, encoding, warnings)?;
        Ok((if as_it_is { scaled } else { factor.clamp(Vec4::ZERO, Vec4::ONE) }, Some(texture)))
    }

    /// Emissive factor, strength and texture. Values above what a picture holds go into the strength.
    fn emission(
        &mut self,
        doc: &mut Document,
        material: usize,
        json: &mut Value,
        warnings: &mut Warnings,
    ) -> Result<()> {
        let source = &self.scene.materials[material];
        let mut emission = source.emission;
        if let Some(slot) = &source.emission_texture {
            let texture = &self.scene.textures[slot.texture];
            let mut peak = 0.0f32;
            for y in 0..texture.height {
                for x in 0..texture.width {
                    let value = (texture.texel(x, y) * slot.scale + slot.bias).truncate().max_element();
                    peak = peak.max(if value.is_finite() { value } else { 0.0 });
                }
            }
            let peak = if peak > 0.0 { peak } else { 1.0 };
            if peak > 1.0 {
                let message = "the emission texture's range is more than a PNG's; it was scaled to 8 bits for the GLB";
                warnings.add(&source.name, message);
            }
            let encoding = Encoding { scale: slot.scale, bias: slot.bias, peak: peak.max(1.0), alpha: false };
            emission *= encoding.peak;
            json["emissiveTexture"] = self.texture(doc, material, slot, encoding, warnings)?;
        }
        let strength = emission.max_element();
        let factor = if strength > 1.0 { emission / strength } else { emission };
        json["emissiveFactor"] = array(factor.clamp(Rgb::ZERO, Rgb::ONE).to_array());
        if strength > 1.0 {
            json["extensions"] = json!({ "KHR_materials_emissive_strength": { "emissiveStrength": number(strength) } });
            doc.use_extension("KHR_materials_emissive_strength");
        }
        Ok(())
    }

    /// A textureInfo for `slot`.
    fn texture(
        &mut self,
        doc: &mut Document,
        material: usize,
        slot: &TextureSlot,
        encoding: Encoding,
        warnings: &mut Warnings,
    ) -> Result<Value> {
        let place = &self.scene.materials[material].name;
        let wrap = |wrap: Wrap| match wrap {
            Wrap::Repeat => 10497,
            Wrap::Mirror => 33648,
            Wrap::Clamp | Wrap::Black => 33071,
        };
        if slot.wrap.contains(&Wrap::Black) {
            warnings.add(place, "a texture that is black outside of its picture repeats its border in the GLB");
        }
        let index =
            self.pictures.write(doc, &self.scene.textures, slot.texture, encoding, slot.wrap.map(wrap), warnings)?;
        let mut info = Object::new();
        info.insert("index".into(), index.into());
        let set = self.sets(material).into_iter().find(|(_, name)| *name == slot.uv_set).map_or(0, |(n, _)| n);
        if set > 0 {
            info.insert("texCoord".into(), set.into());
        }
        if slot.image_from_uv != Affine2::IDENTITY {
            let (transform, exact) = texture_transform(slot.image_from_uv);
            if !exact {
                warnings
                    .add(place, "a sheared texture transform can't be expressed in the GLB; the shear was left out");
            }
            info.insert("extensions".into(), json!({ "KHR_texture_transform": transform }));
            doc.use_extension("KHR_texture_transform");
        }
        Ok(info.into())
    }
}

/// KHR_texture_transform: T * R * S, where the rotation (counter-clockwise as seen, v down) takes (u, v) to
/// (cos u + sin v, -sin u + cos v). False where the transform has a shear besides.
fn texture_transform(image_from_uv: Affine2) -> (Value, bool) {
    let (x, y) = (image_from_uv.matrix2.x_axis, image_from_uv.matrix2.y_axis);
    let rotation = (-x.y).atan2(x.x);
    let (sin, cos) = rotation.sin_cos();
    let scale = [x.length(), sin * y.x + cos * y.y];
    let exact = x.normalize_or_zero().dot(y.normalize_or_zero()).abs() < 1e-4;
    let mut transform = json!({ "offset": array(image_from_uv.translation.to_array()), "scale": array(scale) });
    if rotation != 0.0 {
        transform["rotation"] = number(rotation);
    }
    (transform, exact)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Material;
    use glam::Vec2;

    #[test]
    fn texture_transforms_come_back() {
        for (scale, angle) in [([2.0, 3.0], 0.0), ([0.5, -1.0], 0.7), ([1.0, 1.0], -2.0)] {
            let source = Affine2::from_scale_angle_translation(Vec2::from_array(scale), angle, Vec2::new(0.25, -1.0));
            let (json, exact) = texture_transform(source);
            assert!(exact);
            let f = |v: &Value| v.as_f64().unwrap_or(0.0) as f32;
            let r = f(&json["rotation"]);
            for uv in [Vec2::new(0.3, 0.8), Vec2::new(-1.0, 2.0)] {
                let s = uv * Vec2::new(f(&json["scale"][0]), f(&json["scale"][1]));
                let rotated = Vec2::new(r.cos() * s.x + r.sin() * s.y, -r.sin() * s.x + r.cos() * s.y);
                let out = rotated + Vec2::new(f(&json["offset"][0]), f(&json["offset"][1]));
                assert!(out.distance(source.transform_point2(uv)) < 1e-5, "{out} {json}");
            }
        }
    }

    #[test]
    fn material_sets_go_around_the_lightmap() {
        let slot = |set: &str| Some(TextureSlot::new(0, set));
        let material = Material { albedo_texture: slot("st"), emission_texture: slot("glow"), ..Material::default() };
        let scene = Scene { materials: vec![material], ..Scene::default() };
        let sets = Materials::new(&scene, Some(1)).sets(0);
        assert_eq!(sets, [(0, "st".to_string()), (2, "glow".to_string())]);
        assert_eq!(Materials::new(&scene, None).sets(0)[1].0, 1);
    }
}
