//! The light of a scene in memory: rasterize, direct, exchange, post, in order; or with solve and gather in place of exchange; or
//! rasterize, trace, post.

use crate::Result;
use crate::blocks::{Exchanged, exchange};
use crate::color::Rgb;
use crate::energy::{self, EnergyBalance, balance};
use crate::gather::{Backs, Gathered, Sources, gather, read_elements};
use crate::light::{Direct, Lights, Lit, direct};
use crate::patch::unocclude::{Exposure, unocclude};
use crate::patch::{
    Emission, Ground, Patches, Reflectance, Sparse, rasterize, reflectance::reflectance, reflectance::shown_reflectance,
};
use crate::post::denoise::{Denoise, DenoiseReport, denoise, scales::Scales};
use crate::post::dilate::{Finish, finish};
use crate::post::seam::SeamReport;
use crate::post::{Lightmap, layers::layers};
use crate::progress::Progress;
use crate::reference::{trace, trace_backs};
use crate::scene::Scene;
use crate::settings::{Gather, Method, Settings};
use crate::solve::{Solution, Solver, Watch, full_matrix, solve};
use crate::trace::{Tracer, Triangles};
use crate::transport::{Elements, Probes};
use crate::unwrap::Atlas;
use crate::write::{dump::Dump, watch::WatchFolder};
use std::sync::Arc;

/// A scene with its light, and all that led to it.
pub struct Illuminated {
    pub patches: Patches,
    pub reflectance: Reflectance,
    pub emission: Emission,
    pub exposure: Exposure,
    pub direct: Direct,
    /// Empty where light was exchanged between blocks.
    pub elements: Elements,
    pub solution: Solution,
    pub gathered: Gathered,
    /// How it was exchanged between blocks, where it was.
    pub exchanged: Option<Exchanged>,
    /// How noise was taken out, where it was.
    pub denoised: Option<DenoiseReport>,
    /// How far light jumps across seams.
    pub seams: SeamReport,
    pub lightmap: Lightmap,
    pub energy: EnergyBalance,
}

/// Finds the light of a scene in memory on the pages of `atlas`: everything between unwrapping and writing.
///
/// # Errors
/// `Cancelled`; `Invalid` where no texel is covered, or there are too many elements for the solver; `Io` where stages can't be
/// dumped.
pub fn illuminate(scene: &Scene, atlas: &Atlas, settings: &Settings, progress: &dyn Progress) -> Result<Illuminated> {
    let dump = Dump::new(settings.dump_stages.as_deref());
    // The tree is built by one thread.
    let triangles = Triangles::new(scene);
    let (tracer, patches) =
        rayon::join(|| Tracer::with(scene, triangles.clone()), || rasterize(scene, atlas, &triangles, progress));
    let patches = patches?;
    let ground = Ground { scene, atlas, tracer: &tracer, patches: &patches };
    let (reflectance, emission) = reflectance(&ground, progress)?;
    let exposure = unocclude(&ground, settings.seed, progress)?;
    dump.patches("normal", &ground, |i| patches.normal[i])?;
    dump.patches("albedo", &ground, |i| reflectance.0[i])?;
    dump.patches("emission", &ground, |i| emission.0[i])?;
    dump.patches("exposure", &ground, |i| exposure.share(i))?;

    let lights = Lights::new(scene);
    let lit = Lit {
        ground: &ground,
        exposure: &exposure,
        reflectance: &reflectance,
        emission: &emission,
        lights: &lights,
        params: &settings.direct_params(),
    };
    let elements = || Elements::new(&ground, &exposure, &reflectance, settings.element_count(), settings.seed);
    let Found { direct, elements, solution, mut gathered, backs, exchanged } =
        match (settings.method, settings.gather()) {
            (Method::Path, _) => paths(&lit, elements(), settings, &dump, progress)?,
            (Method::Radiosity, Gather::Blocks) => by_blocks(&lit, settings, &dump, progress)?,
            (Method::Radiosity, _) => by_elements(&lit, elements(), settings, &dump, progress)?,
        };

    let denoised = denoise(&lit, &mut gathered, &settings.denoise_params(), progress)?;
    if denoised.is_some() {
        dump.patches("denoised", &ground, |i| gathered.indirect[i])?;
    }
    if exchanged.is_some() && settings.layers.is_empty() {
        (gathered.indirect, gathered.difference) = (Vec::new(), Vec::new());
    }
    progress.begin("post", 0);
    // What doesn't cast is black as a source, but has its own look on the pages.
    let looks = match scene.surfaces.iter().all(|s| s.role.casts) {
        true => None,
        false => Some(shown_reflectance(&ground, progress)?),
    };
    let shown = match &looks {
        Some((reflectance, emission)) => Lit { reflectance, emission, ..lit },
        None => lit,
    };
    let to = Finish::new(shown, settings.seams, settings.gutter, settings.quantity);
    let (mut lightmap, seams) = finish(&to, &gathered.irradiance, settings.quantity);
    lightmap.layers = layers(&to, &direct, &gathered, &settings.layers, settings.quantity);
    let bake = energy::Bake { lit, direct: &direct, backs: &backs, gathered: &gathered };
    let energy = balance(&bake, &lightmap, !settings.float);
    Ok(Illuminated {
        patches,
        reflectance,
        emission,
        exposure,
        direct,
        elements,
        solution,
        gathered,
        exchanged,
        denoised,
        seams,
        lightmap,
        energy,
    })
}

/// The light of all texels, and how it was found.
struct Found {
    direct: Direct,
    elements: Elements,
    solution: Solution,
    gathered: Gathered,
    backs: Backs,
    exchanged: Option<Exchanged>,
}

/// The light by radiosity between blocks of texels.
fn by_blocks(lit: &Lit, settings: &Settings, dump: &Dump, progress: &dyn Progress) -> Result<Found> {
    let direct = direct(lit, progress)?;
    dump.patches("direct", lit.ground, |i| direct.shown[i])?;
    let (gathered, backs, exchanged) = exchange(lit, &direct, &settings.block_params(), progress)?;
    dump.patches("indirect", lit.ground, |i| gathered.irradiance[i] - direct.shown[i])?;
    let (elements, solution) = (Elements::default(), Solution::default());
    Ok(Found { direct, elements, solution, gathered, backs, exchanged: Some(exchanged) })
}

/// The light by radiosity between elements, and a gather.
fn by_elements(
    lit: &Lit,
    elements: Elements,
    settings: &Settings,
    dump: &Dump,
    progress: &dyn Progress,
) -> Result<Found> {
    if settings.solver == Solver::FullMatrix {
        // Backs come on top of what the settings say.
        full_matrix::refuse_too_many(elements.len())?;
    }
    let direct = direct(lit, progress)?;
    dump.patches("direct", lit.ground, |i| direct.shown[i])?;

    let params = settings.solve_params(elements.len());
    let probes = Probes::new(&elements, *lit, params.transport.probe_rays);
    let pages = settings.watch.as_deref().map(|folder| WatchFolder::new(folder, lit, &direct, settings.quantity));
    let mut show = |iteration: u64, received: &[Rgb]| match &pages {
        Some(pages) => pages.show(iteration, lit, |i| direct.shown[i] + elements.read(received, i)),
        None => Ok(()),
    };
    let watch = settings.watch.is_some().then_some(Watch { every: settings.watch_every, show: &mut show });
    let solution = solve(&elements, lit, &probes, &direct, &params, watch, progress)?;
    dump.patches("solution", lit.ground, |i| elements.read(&solution.irradiance, i))?;

    let gathered = match settings.gather() {
        Gather::None => read_elements(lit, &elements, &probes, &direct, &solution, progress)?,
        _ => {
            let sources = Sources::new(lit, &direct, &elements, &solution, settings.max_bounces);
            gather(lit, &sources, &direct, &settings.gather_params(), progress)?
        }
    };
    dump.patches("indirect", lit.ground, |i| gathered.indirect[i])?;
    drop(probes);
    let backs = Backs::of_elements(&elements, &solution);
    Ok(Found { direct, elements, solution, gathered, backs, exchanged: None })
}

/// The light by paths. What comes straight from the sky counts as direct light here; of the elements, only the backs get light.
fn paths(lit: &Lit, elements: Elements, settings: &Settings, dump: &Dump, progress: &dyn Progress) -> Result<Found> {
    let params = settings.path_params();
    let traced = trace(lit, &params, progress)?;
    let backs = trace_backs(lit, &elements, &params, progress)?;
    dump.patches("direct", lit.ground, |i| traced.direct[i])?;
    dump.patches("error", lit.ground, |i| traced.standard_error[i])?;
    let noise = traced.noise(lit.exposure);
    let indirect: Vec<Rgb> = traced.irradiance.iter().zip(&traced.direct).map(|(e, d)| *e - *d).collect();
    dump.patches("indirect", lit.ground, |i| indirect[i])?;
    let [difference, mut direct_difference] = traced.difference;
    let mut direct = traced.direct;
    let mut irradiance = traced.irradiance;
    if settings.denoise_params().filter != Denoise::Off {
        // Here the noise of direct light is known as well.
        Scales::SINGLE.filter(lit, &mut direct, &mut direct_difference, &mut [], progress)?;
        irradiance = direct.iter().zip(&indirect).map(|(d, i)| *d + *i).collect();
    }
    let transport = Arc::new(direct);
    let shown = Sparse::same(Arc::clone(&transport));
    let direct = Direct { transport, shown, inflow: traced.inflow, rays: traced.rays };
    let gathered = Gathered {
        sky: vec![Rgb::ZERO; irradiance.len()],
        irradiance,
        difference,
        standard_error: traced.standard_error,
        indirect,
        parts: Vec::new(),
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
    let backs = Backs::of_elements(&elements, &solution);
    Ok(Found { direct, elements, solution, gathered, backs, exchanged: None })
}
