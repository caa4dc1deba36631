//! Engines that a bake goes into, and what each of them does with a page: which quantity it multiplies the albedo by,
//! which files it reads, and which way its v runs. A note beside the result says how to load it ([`note`]).
//!
//! What leaves a diffuse wall is L = albedo * E / pi. An engine whose shader multiplies a texel by the albedo alone
//! wants E / pi, one whose shader divides by pi as well wants E:
//!
//! | engine | what its shader does with the texel | read in |
//! |---|---|---|
//! | Bevy 0.19 | `indirect_light += texel * lightmap_exposure * diffuse_color`, all times the view's exposure | `bevy_pbr`: `lightmap.wgsl`, `pbr_functions.wgsl` |
//! | three.js r187 | `texel * lightMapIntensity / PI * diffuseColor` | `lights_fragment_maps.glsl.js`, `lights_lambert_pars_fragment.glsl.js` |
//! | PlayCanvas 2.23 | `dDiffuseLight += decode(texel)`, times the albedo | `lightmapAdd.js`, `combine.js` |
//! | Babylon.js 9 | `finalColor.rgb *= decode(texel) * level` with `useLightmapAsShadowmap`, else added *without* the albedo | `pbrBlockLightmapInit`, `pbrBlockFinalColorComposition` |
//! | Needle Engine 4 | as three.js, decoded as RGBM | `engine_lightdata.ts` |
//! | Hubs | as three.js | the extension MOZ_lightmap |
//! | Unity | `bakedGI * diffuse`, E / pi by its convention | the render pipelines' `GlobalIllumination.hlsl` |
//! | Godot, Unreal, Blender | nothing by themselves: a material multiplies texel and albedo into emission | |

mod note;

pub use note::{Told, note};

use super::encode::Encoding;
use crate::post::Quantity;

/// An engine, or a program that shows lightmaps.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Engine {
    Bevy,
    Godot,
    Unity,
    Unreal,
    Three,
    Playcanvas,
    Babylon,
    Blender,
    Needle,
    Hubs,
}

/// Which way v runs in an engine's UVs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Vertical {
    Down,
    Up,
}

/// Where a GLB names its pages besides the `lumel` extras: vendors' extensions.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum LightmapExtension {
    /// MOZ_lightmap on materials (Hubs).
    Moz,
    /// MX_lightmap on nodes (Third Room).
    Mx,
    /// NEEDLE_lightmaps at the root, and a renderer component on nodes (Needle Engine).
    Needle,
}

impl LightmapExtension {
    /// The encodings that it can name, the preferred one first.
    pub fn encodings(self) -> &'static [Encoding] {
        match self {
            // Radiance HDR by MOZ_texture_rgbe.
            Self::Moz => &[Encoding::Hdr],
            // glTF's own pictures alone; the range comes back by the texture's alpha.
            Self::Mx => &[Encoding::Rgbm, Encoding::RgbmSrgb, Encoding::Rgbd],
            // The engine decodes every lightmap as this.
            Self::Needle => &[Encoding::RgbmSrgb],
        }
    }

    /// Its name in settings.
    pub fn name(self) -> &'static str {
        match self {
            Self::Moz => "moz",
            Self::Mx => "mx",
            Self::Needle => "needle",
        }
    }
}

impl Engine {
    /// Its name for people.
    pub fn title(self) -> &'static str {
        match self {
            Self::Bevy => "Bevy",
            Self::Godot => "Godot",
            Self::Unity => "Unity",
            Self::Unreal => "Unreal Engine",
            Self::Three => "three.js",
            Self::Playcanvas => "PlayCanvas",
            Self::Babylon => "Babylon.js",
            Self::Blender => "Blender",
            Self::Needle => "Needle Engine",
            Self::Hubs => "Hubs",
        }
    }

    /// The quantity that it multiplies by.
    pub fn quantity(self) -> Quantity {
        match self {
            Self::Three | Self::Needle | Self::Hubs => Quantity::Irradiance,
            _ => Quantity::Outgoing,
        }
    }

    /// The form of pages that it reads best.
    pub fn encoding(self) -> Encoding {
        match self {
            Self::Bevy => Encoding::Ktx2Half,
            Self::Playcanvas => Encoding::Rgbm,
            Self::Babylon => Encoding::Rgbd,
            Self::Needle => Encoding::RgbmSrgb,
            Self::Hubs => Encoding::Hdr,
            Self::Godot | Self::Unity | Self::Unreal | Self::Three | Self::Blender => Encoding::Exr,
        }
    }

    /// The extension by which it finds pages, where it knows one.
    pub fn lightmap_extension(self) -> Option<LightmapExtension> {
        match self {
            Self::Needle => Some(LightmapExtension::Needle),
            Self::Hubs => Some(LightmapExtension::Moz),
            _ => None,
        }
    }

    /// Which way v runs in the rectangles that it takes.
    pub fn vertical(self) -> Vertical {
        match self {
            Self::Unity | Self::Blender | Self::Playcanvas | Self::Needle => Vertical::Up,
            _ => Vertical::Down,
        }
    }

    /// The albedo's factor per unit of a texel: 1, or 1 / pi where the shader divides.
    fn albedo_factor(self) -> f32 {
        match self.quantity() {
            Quantity::Irradiance => std::f32::consts::FRAC_1_PI,
            _ => 1.0,
        }
    }

    /// What texels of `quantity` must be multiplied by in this engine's own lightmap slot, for walls to show albedo * E
    /// / pi; none for radiosity, which holds the albedo already.
    pub fn intensity(self, quantity: Quantity) -> Option<f32> {
        let radiance = match quantity {
            Quantity::Outgoing => 1.0,
            Quantity::Irradiance => std::f32::consts::FRAC_1_PI,
            Quantity::Radiosity => return None,
        };
        Some(radiance / self.albedo_factor())
    }
}

/// A rectangle as an engine takes it: UV * (x, y) + (z, w).
pub fn rectangle(placement: &crate::unwrap::Placement, vertical: Vertical) -> [f32; 4] {
    let (scale, offset) = (placement.scale, placement.offset);
    let y = match vertical {
        Vertical::Down => offset.y,
        // v' = 1 - v in the mesh and on the page alike.
        Vertical::Up => 1.0 - scale.y - offset.y,
    };
    [scale.x, scale.y, offset.x, y]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::unwrap::Placement;
    use glam::Vec2;
    use std::f32::consts::PI;

    #[test]
    fn rectangles_turn_over_with_v() {
        let placement = Placement { page: 0, scale: Vec2::new(0.25, 0.5), offset: Vec2::new(0.125, 0.375) };
        let (down, up) = (rectangle(&placement, Vertical::Down), rectangle(&placement, Vertical::Up));
        for v in [0.0, 0.3, 1.0] {
            let (page_down, page_up) = (v * down[1] + down[3], (1.0 - v) * up[1] + up[3]);
            assert!((page_down - (1.0 - page_up)).abs() < 1e-6);
        }
    }

    #[test]
    fn every_quantity_shows_the_same_wall() {
        assert_eq!(Engine::Bevy.intensity(Quantity::Outgoing), Some(1.0));
        assert!((Engine::Bevy.intensity(Quantity::Irradiance).unwrap() - 1.0 / PI).abs() < 1e-6);
        assert_eq!(Engine::Three.intensity(Quantity::Irradiance), Some(1.0));
        assert!((Engine::Three.intensity(Quantity::Outgoing).unwrap() - PI).abs() < 1e-5);
        assert_eq!(Engine::Unity.intensity(Quantity::Radiosity), None);
    }
}
