//! The light of a scene in memory: rasterize, direct, solve, gather, post, in order.

use crate::Result;
use crate::color::Rgb;
use crate::energy::{self, EnergyBalance, balance};
use crate::gather::{Gathered, Sources, gather, read_elements};
use crate::light::{Direct, Lights, Lit, direct};
use crate::patch::unocclude::{Exposure, unocclude};
use crate::patch::{Emission, Ground, Patches, Reflectance, rasterize, reflectance::reflectance};
use crate::post::{Lightmap, dilate::finish, layers::layers};
use crate::progress::Progress;
use crate::scene::Scene;
use crate::settings::{Gather, Settings};
use crate::solve::{Solution, Solver, Watch, full_matrix, solve};
use crate::trace::Tracer;
use crate::transport::{Elements, Probes};
use crate::unwrap::Atlas;
use crate::write::{dump::Dump, watch::WatchFolder};

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
    let params = settings.direct_params();
    let lit = Lit {
        ground: &ground,
        exposure: &exposure,
        reflectance: &reflectance,
        emission: &emission,
        lights: &lights,
        params: &params,
    };
    let elements = Elements::new(&ground, &exposure, &reflectance, settings.element_count(), settings.seed);
    if settings.solver == Solver::FullMatrix {
        // Backs come on top of what the settings say.
        full_matrix::refuse_too_many(elements.len())?;
    }
    let direct = direct(&lit, progress)?;
    dump.patches("direct", &ground, |i| direct.shown[i])?;

    let solve_params = settings.solve_params();
    let probes = Probes::new(&elements, lit, solve_params.transport.probe_rays);
    let mut pages = settings.watch.as_deref().map(|folder| WatchFolder::new(folder, &lit, &direct, settings.quantity));
    let mut show = |iteration: u64, received: &[Rgb]| match &mut pages {
        Some(pages) => pages.show(iteration, &lit, |i| direct.shown[i] + elements.read(received, i)),
        None => Ok(()),
    };
    let watch = settings.watch.is_some().then_some(Watch { every: settings.watch_every, show: &mut show });
    let solution = solve(&elements, &lit, &probes, &direct, &solve_params, watch, progress)?;
    dump.patches("solution", &ground, |i| elements.read(&solution.irradiance, i))?;

    let gathered = match settings.gather {
        Gather::Final => {
            let sources = Sources::new(&lit, &direct, &elements, &solution, settings.max_bounces);
            gather(&lit, &sources, &direct, &settings.gather_params(), progress)?
        }
        Gather::None => read_elements(&lit, &elements, &probes, &direct, &solution, progress)?,
    };
    dump.patches("indirect", &ground, |i| gathered.indirect[i])?;

    progress.begin("post", 0);
    let mut lightmap = finish(&lit, &gathered.irradiance, settings.quantity);
    lightmap.layers = layers(&lit, &direct, &gathered, &settings.layers, settings.quantity);
    let bake = energy::Bake { lit, direct: &direct, elements: &elements, solution: &solution, gathered: &gathered };
    let energy = balance(&bake, &lightmap, !settings.float);
    Ok(Illuminated { patches, reflectance, emission, exposure, direct, elements, solution, gathered, lightmap, energy })
}
