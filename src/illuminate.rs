//! The light of a scene in memory: rasterize, direct, solve, gather, post, in order; or rasterize, trace, post.

use crate::Result;
use crate::energy::{self, EnergyBalance, balance};
use crate::gather::{Gathered, Sources, gather};
use crate::light::{Direct, Lights, direct};
use crate::patch::unocclude::{Exposure, unocclude};
use crate::patch::{Emission, Ground, Patches, Reflectance, rasterize, reflectance::reflectance};
use crate::post::{Lightmap, dilate::finish};
use crate::progress::Progress;
use crate::reference::{trace, trace_backs};
use crate::scene::Scene;
use crate::settings::{Method, Settings};
use crate::solve::{Solution, solve};
use crate::trace::Tracer;
use crate::transport::Elements;
use crate::unwrap::Atlas;
use crate::write::dump::Dump;

/// A scene with its light, and all that led to it.
pub struct Illuminated {
    pub patches: Patches,
    pub reflectance: Reflectance,
    pub emission: Emission,
    pub exposure: Exposure,
    pub direct: Direct,
    pub elements: Elements,
    pub solution: Solution,
    pub gathered: Gathered,
    pub lightmap: Lightmap,
    pub energy: EnergyBalance,
}

/// Finds the light of a scene in memory on the pages of `atlas`: everything between unwrapping and writing.
///
/// # Errors
/// `Cancelled`; `Invalid` where no texel is covered; `Io` where stages can't be dumped.
pub fn illuminate(scene: &Scene, atlas: &Atlas, settings: &Settings, progress: &dyn Progress) -> Result<Illuminated> {
    let dump = Dump::new(settings.dump_stages.as_deref());
    let tracer = Tracer::new(scene);
    let patches = rasterize(scene, atlas, &tracer, progress)?;
    let ground = Ground { scene, atlas, tracer: &tracer, patches: &patches };
    let (reflectance, emission) = reflectance(&ground, progress)?;
    let exposure = unocclude(&ground, settings.seed, progress)?;
    dump.patches("normal", &ground, |i| patches.normal[i])?;
    dump.patches("albedo", &ground, |i| reflectance.0[i])?;
    dump.patches("emission", &ground, |i| emission.0[i])?;
    dump.patches("exposure", &ground, |i| exposure.share(i))?;

    let lights = Lights::new(scene);
    let lit = match settings.method {
        Method::Radiosity => radiosity(&ground, &lights, &exposure, &reflectance, settings, progress, &dump)?,
        Method::Path => paths(&ground, &lights, &exposure, &reflectance, settings, progress, &dump)?,
    };
    let Lit { direct, elements, solution, gathered } = lit;

    progress.begin("post", 0);
    let irradiance = &gathered.irradiance;
    let lightmap = finish(atlas, &patches, &exposure, irradiance, &reflectance, &emission, settings.quantity);
    let bake = energy::Bake {
        ground: &ground,
        exposure: &exposure,
        reflectance: &reflectance,
        emission: &emission,
        direct: &direct,
        elements: &elements,
        solution: &solution,
        gathered: &gathered,
    };
    let energy = balance(&bake, &lightmap, !settings.float);
    Ok(Illuminated { patches, reflectance, emission, exposure, direct, elements, solution, gathered, lightmap, energy })
}

/// The light of all texels, and how it was found.
struct Lit {
    direct: Direct,
    elements: Elements,
    solution: Solution,
    gathered: Gathered,
}

/// The light by radiosity.
fn radiosity(
    ground: &Ground,
    lights: &Lights,
    exposure: &Exposure,
    reflectance: &Reflectance,
    settings: &Settings,
    progress: &dyn Progress,
    dump: &Dump,
) -> Result<Lit> {
    let direct_params = settings.direct_params();
    let direct = direct(ground, lights, exposure, &direct_params, progress)?;
    dump.patches("direct", ground, |i| direct.shown[i])?;

    let elements = Elements::new(ground, exposure, reflectance, settings.element_count(), settings.seed);
    let solution = solve(
        &elements,
        ground,
        exposure,
        lights,
        reflectance,
        &direct,
        &direct_params,
        &settings.solve_params(),
        progress,
    )?;
    dump.patches("solution", ground, |i| elements.read(&solution.irradiance, i))?;

    let sources = Sources::new(reflectance, &direct, &elements, &solution, settings.max_bounces);
    let gather_params = settings.gather_params();
    let gathered = gather(ground, exposure, lights, &sources, &direct, &direct_params, &gather_params, progress)?;
    dump.patches("indirect", ground, |i| gathered.indirect[i])?;
    Ok(Lit { direct, elements, solution, gathered })
}

/// The light by paths. What comes straight from the sky counts as direct light here; of the elements, only the backs get light.
fn paths(
    ground: &Ground,
    lights: &Lights,
    exposure: &Exposure,
    reflectance: &Reflectance,
    settings: &Settings,
    progress: &dyn Progress,
    dump: &Dump,
) -> Result<Lit> {
    let params = settings.path_params();
    let traced = trace(ground, exposure, reflectance, lights, &params, progress)?;
    let elements = Elements::new(ground, exposure, reflectance, settings.element_count(), settings.seed);
    let backs = trace_backs(ground, exposure, reflectance, lights, &elements, &params, progress)?;
    dump.patches("direct", ground, |i| traced.direct[i])?;
    dump.patches("error", ground, |i| traced.standard_error[i])?;
    let noise = traced.noise(exposure);
    let indirect: Vec<_> = traced.irradiance.iter().zip(&traced.direct).map(|(e, d)| *e - *d).collect();
    dump.patches("indirect", ground, |i| indirect[i])?;
    let direct =
        Direct { transport: traced.direct.clone(), shown: traced.direct, inflow: traced.inflow, rays: traced.rays };
    let gathered = Gathered {
        irradiance: traced.irradiance,
        indirect,
        landed_share: traced.landed_share,
        noise,
        sky_inflow: glam::DVec3::ZERO,
        rays: 0,
    };
    let solution = Solution {
        irradiance: backs.irradiance,
        landed_share: backs.landed_share,
        inflow: backs.inflow,
        rays: backs.rays,
        ..Solution::default()
    };
    Ok(Lit { direct, elements, solution, gathered })
}
