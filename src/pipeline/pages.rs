//! The pages of a bake, read back from its output folder with all of their layers.

use crate::color::Rgb;
use crate::compare::{Page, ReadLayer, read_layers};
use crate::error::{Error, Result};
use crate::post::{Layer, Lightmap, PageImage, Quantity};
use serde_json::Value;
use std::path::Path;

/// The pages of a bake as they were read.
pub(super) struct Pages {
    pub pages: Vec<Page>,
    /// Of each page, the same ones in the same order.
    pub layers: Vec<Vec<ReadLayer>>,
    /// Of layers that are of a light or group: its name.
    pub of: Vec<Option<String>>,
    /// What the bake said of itself.
    pub report: Value,
}

impl Pages {
    /// The pages in the output folder `folder`; `advice` is for one that has none.
    ///
    /// # Errors
    /// `Io` where they can't be read; `Invalid` where there are none, or they aren't of one bake.
    pub fn read(folder: &Path, advice: &str) -> Result<Self> {
        let path = folder.join("report.json");
        let text = std::fs::read(&path).map_err(|e| Error::io(&path, e))?;
        let report: Value = serde_json::from_slice(&text).map_err(|e| Error::invalid(path.display(), e))?;
        let listed = report["pages"].as_array().map_or(&[][..], Vec::as_slice);
        let uris = listed.iter().map(|page| page["uri"].as_str().filter(|uri| uri.ends_with(".exr")));
        let Some(uris) = uris.collect::<Option<Vec<&str>>>().filter(|uris| !uris.is_empty()) else {
            return Err(Error::invalid(path.display(), format!("names no OpenEXR pages; {advice}")));
        };
        let (mut pages, mut layers) = (Vec::new(), Vec::new());
        for uri in uris {
            let (page, of_page) = read_layers(&folder.join(uri))?;
            pages.push(page);
            layers.push(of_page);
        }
        let names = |of_page: &[ReadLayer]| of_page.iter().map(|l| l.name.clone()).collect::<Vec<_>>();
        if layers.iter().any(|of_page| names(of_page) != names(&layers[0])) {
            return Err(Error::invalid(folder.display(), "its pages have different layers; bake anew"));
        }
        let told = report["layers"].as_array().map_or(&[][..], Vec::as_slice);
        let of = |layer: &ReadLayer| {
            let own = told.iter().find(|l| l["name"].as_str() == Some(&layer.name));
            own.and_then(|l| l["of"].as_str()).map(str::to_owned)
        };
        let of = layers[0].iter().map(of).collect();
        Ok(Self { pages, layers, of, report })
    }

    /// The names of the layers.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.layers[0].iter().map(|layer| layer.name.as_str())
    }

    /// True where some page holds 32-bit floats.
    pub fn is_float(&self) -> bool {
        let listed = self.report["pages"].as_array().map_or(&[][..], Vec::as_slice);
        listed.iter().any(|page| page["samples"].as_str() == Some("float"))
    }

    /// True where their sizes are `sizes`, in order.
    pub fn have_sizes(&self, sizes: impl Iterator<Item = [u32; 2]>) -> bool {
        self.pages.iter().map(|page| [page.width, page.height]).eq(sizes.map(|size| size.map(|n| n as usize)))
    }

    /// True where their sizes are those that `sizes` begin with, in order.
    pub fn begin(&self, sizes: &[[u32; 2]]) -> bool {
        self.pages.len() <= sizes.len() && self.have_sizes(sizes[..self.pages.len()].iter().copied())
    }

    /// The pages as a lightmap of `quantity`, with black ones for those of `sizes` that there were none of.
    pub fn into_lightmap(mut self, quantity: Quantity, sizes: &[[u32; 2]]) -> Lightmap {
        let image = |page: Page| {
            let (width, height) = (page.width as u32, page.height as u32);
            PageImage { width, height, rgb: page.rgb, coverage: page.coverage }
        };
        let more = &sizes[self.pages.len().min(sizes.len())..];
        let black = |size: &[u32; 2]| vec![Rgb::ZERO; size[0] as usize * size[1] as usize];
        let layer = |(k, of): (usize, Option<String>)| {
            let ReadLayer { name, channels, unit, .. } = &self.layers[0][k];
            let (name, channels, unit) = (name.clone(), *channels, *unit);
            let read = self.layers.iter_mut().map(|l| std::mem::take(&mut l[k].values));
            Layer { name, pages: read.chain(more.iter().map(black)).collect(), channels, unit, of }
        };
        let layers = self.of.into_iter().enumerate().map(layer).collect();
        let blank = |size: &[u32; 2]| {
            let rgb = black(size);
            PageImage { width: size[0], height: size[1], coverage: vec![0.0; rgb.len()], rgb }
        };
        let pages = self.pages.into_iter().map(image).chain(more.iter().map(blank)).collect();
        Lightmap { pages, quantity, layers }
    }
}
