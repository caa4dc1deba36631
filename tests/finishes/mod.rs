//! Surfaces that scatter in all ways, each on a scene of one triangle.
#![allow(dead_code)] // each test file uses its own share

use glam::{Affine3A, Vec2, Vec3};
use lumel::color::Rgb;
use lumel::scatter::{Bsdf, Scattering, Surfaces, adapt};
use lumel::scene::{
    Appearance, Dielectric, Lobe, Lobes, Material, Mesh, Scene, Surface, SurfaceOrigin, TriangleOrigin, UvSet, Walls,
};

/// A material on one triangle, with UVs and without textures.
pub fn scene_of(material: Material) -> Scene {
    let positions = vec![Vec3::ZERO, Vec3::X, Vec3::Y];
    let coords = vec![Vec2::ZERO, Vec2::X, Vec2::Y];
    let mesh = Mesh {
        positions,
        uvs: vec![UvSet { name: "TEXCOORD_0".to_owned(), coords }],
        triangles: vec![[0, 1, 2]],
        triangle_material: vec![0],
        origin: vec![TriangleOrigin::default()],
        ..Mesh::default()
    };
    let surface = Surface {
        name: "triangle".to_owned(),
        mesh: 0,
        world_from_local: Affine3A::IDENTITY,
        origin: SurfaceOrigin::None,
        role: Default::default(),
    };
    Scene { meshes: vec![mesh], materials: vec![material], surfaces: vec![surface], ..Scene::default() }
}

/// A surface ready to be looked at.
pub struct Finish {
    pub name: String,
    pub scene: Scene,
    pub scattering: Scattering,
    /// It absorbs nothing, whichever side it is seen from.
    pub is_white: bool,
}

impl Finish {
    /// A surface of this look; its diffuse stand-in is the base colour.
    pub fn new(name: impl Into<String>, is_white: bool, appearance: Appearance) -> Self {
        let through = appearance.base_color * appearance.transmission;
        let material = Material {
            albedo: appearance.base_color * (1.0 - appearance.transmission),
            transmission: through,
            appearance: Some(appearance),
            ..Material::default()
        };
        Self::of(name, is_white, material)
    }

    pub fn of(name: impl Into<String>, is_white: bool, material: Material) -> Self {
        let mut scene = scene_of(material);
        adapt(&mut scene, Surfaces::Full);
        let scattering = Scattering::new(&scene, Surfaces::Full);
        Self { name: name.into(), scene, scattering, is_white }
    }

    pub fn bsdf(&self) -> Bsdf<'_> {
        self.scattering.at(&self.scene, 0, 0, [0.25, 0.25])
    }

    /// The sides that it can be seen from: signs of z.
    pub fn sides(&self) -> &'static [f32] {
        let appearance = self.scene.materials[0].appearance.as_ref();
        let sees_both = appearance.is_some_and(|a| a.transmission > 0.0 && a.measured.is_none());
        if sees_both { &[1.0, -1.0] } else { &[1.0] }
    }
}

/// Roughnesses that are tried.
pub const ROUGHNESSES: [f32; 6] = [0.0, 0.07, 0.2, 0.45, 0.8, 1.0];

pub fn metal(color: Rgb, roughness: f32) -> Appearance {
    Appearance { base_color: color, metallic: 1.0, roughness, ..Appearance::default() }
}

pub fn glossy(color: Rgb, roughness: f32) -> Appearance {
    let dielectric = Dielectric { specular: 0.999, ..Dielectric::default() };
    Appearance { base_color: color, roughness, dielectric, ..Appearance::default() }
}

pub fn glass(ior: f32, roughness: f32) -> Appearance {
    Appearance {
        transmission: 1.0,
        roughness,
        walls: Walls::Solid { absorption: Rgb::ZERO },
        dielectric: Dielectric { ior, ..Dielectric::default() },
        ..Appearance::default()
    }
}

pub fn sheet(roughness: f32) -> Appearance {
    Appearance { walls: Walls::Thin, ..glass(1.5, roughness) }
}

pub fn coated(coat_roughness: f32, below: Appearance) -> Appearance {
    Appearance { clearcoat: 0.9, clearcoat_roughness: coat_roughness, ..below }
}

/// A forward lobe and one that shines back, of a blue-grey plastic.
pub fn lobes() -> Lobes {
    let lobe =
        |xy: [f32; 3], z: [f32; 3], n: [f32; 3]| Lobe { x: xy.into(), y: xy.into(), z: z.into(), exponent: n.into() };
    Lobes {
        diffuse: Rgb::new(0.2, 0.25, 0.4),
        lobes: vec![
            lobe([-0.9, -0.95, -0.98], [0.85, 0.8, 0.75], [20.0, 30.0, 15.0]),
            lobe([0.5, 0.4, 0.3], [0.4, 0.5, 0.5], [2.0, 3.0, 2.5]),
        ],
    }
}

/// All kinds of surface at all roughnesses.
pub fn all() -> Vec<Finish> {
    let mut all = Vec::new();
    let tint = Rgb::new(0.9, 0.5, 0.2);
    for roughness in ROUGHNESSES {
        let mut add = |name: &str, is_white: bool, look: Appearance| {
            all.push(Finish::new(format!("{name} of roughness {roughness}"), is_white, look));
        };
        add("white metal", true, metal(Rgb::ONE, roughness));
        add("gold", false, metal(Rgb::new(1.0, 0.77, 0.34), roughness));
        add("plastic", false, glossy(tint, roughness));
        add("glass", true, glass(1.5, roughness));
        add("diamond", true, glass(2.4, roughness));
        add("tinted glass", false, Appearance { base_color: tint, transmission: 0.6, ..glass(1.33, roughness) });
        add("sheet", roughness > 0.0, sheet(roughness));
        add("mixture", false, Appearance { metallic: 0.4, ..glossy(tint, roughness) });
        add("coated plastic", false, coated(0.1, glossy(tint, roughness)));
        add("metal under a smooth coat", false, coated(0.0, metal(tint, roughness)));
        add("coated glass", false, coated(0.3, glass(1.5, roughness)));
        let colored = Dielectric { ior: 1.8, specular: 0.8, color: tint, ..Dielectric::default() };
        add("coloured mirror", false, Appearance { dielectric: colored, ..glossy(Rgb::splat(0.5), roughness) });
        let workflow = Dielectric { ior: 0.0, color: Rgb::splat(0.3), ..Dielectric::default() };
        add("specular workflow", false, Appearance { dielectric: workflow, ..glossy(Rgb::splat(0.5), roughness) });
    }
    all.push(Finish::new("lobes", false, Appearance { measured: Some(lobes()), ..Appearance::default() }));
    let tinted = Appearance { base_color: tint, transmission: 0.7, ..sheet(0.0) };
    all.push(Finish::new("tinted pane", false, tinted));
    all.push(Finish::of("matte", false, Material::default()));
    all
}

/// The direction at a cosine and an azimuth, on the side of the cosine's sign.
pub fn direction(cos: f32, azimuth: f32) -> Vec3 {
    let sin = (1.0 - cos * cos).max(0.0).sqrt();
    Vec3::new(sin * azimuth.cos(), sin * azimuth.sin(), cos)
}
