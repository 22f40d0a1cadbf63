//! Options of lit pictures, and the engine's settings that they become.

use anyhow::{Result, ensure};
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use clap::{Args as ClapArgs, ValueEnum};
use esker_engine::Method;
use esker_engine::io::quantity;
use esker_engine::light::check_built;
use esker_engine::light::settings::{
    BOUNCES, FILTERS, FilterName, Gloss, LightSettings, SAMPLES, SHADOW_SAMPLES, filter_of_name,
};
use esker_engine::light::spec::{LightSpec, joined};
use std::path::PathBuf;

/// Options of `--method lit`; none of them changes other pictures.
#[derive(ClapArgs)]
#[command(next_help_heading = "Options of --method lit")]
pub struct LightArgs {
    /// Lights: sun:AZIMUTH,ELEVATION[,STRENGTH[,DIAMETER]] (degrees, from north over east, above
    /// the horizon), sky[:STRENGTH], sky:PICTURE.png[,STRENGTH], lamp:X,Y,Z[,STRENGTH], or files of
    /// lights (docs/commands.md); sun:225,40 and sky by default.
    #[allow(rustdoc::broken_intra_doc_links, reason = "brackets stand for optional parts")]
    #[arg(long, num_args = 1.., value_name = "LIGHT")]
    pub lights: Vec<LightSpec>,
    /// Rays through a pixel.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(SAMPLES))]
    pub samples: Option<u32>,
    /// Times that light is reflected before it reaches the surface that is seen; 0 for direct light
    /// alone.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(BOUNCES))]
    pub bounces: Option<u32>,
    /// Rays to each light of finite size, for each ray through a pixel.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(SHADOW_SAMPLES))]
    pub shadow_samples: Option<u32>,
    /// Filter of indirect light; nested by default.
    #[arg(long = "filter", value_name = "NAME", value_parser = filter_parser())]
    pub light_filter: Option<FilterName>,
    /// Filter the shadows of lights of finite size too, which softens their noise and their edges;
    /// not with --gloss.
    #[arg(long, conflicts_with = "gloss")]
    pub filter_shadows: bool,
    /// Gloss of all surfaces: the share of light that they mirror at right angles, 0 to 1, and
    /// their roughness, 0.05 to 1 (0.3 by default). Varnish has 0.04.
    #[allow(rustdoc::broken_intra_doc_links, reason = "brackets stand for optional parts")]
    #[arg(long, value_name = "REFLECTANCE[,ROUGHNESS]")]
    pub gloss: Option<Gloss>,
    /// Seed of the random numbers: the same seed makes the same picture.
    #[arg(long, value_name = "S")]
    pub seed: Option<u64>,
    /// What surfaces reflect, in place of the colours of --colour.
    #[arg(long, value_enum, value_name = "OF", conflicts_with = "colour")]
    pub albedo: Option<AlbedoArg>,
    /// Factor from light to the picture; chosen by the picture by default, and reported.
    #[arg(long, value_name = "FACTOR", value_parser = quantity::exposure)]
    pub exposure: Option<f64>,
    /// Triangle meshes (.ply, .obj) that stand in the scan, in its coordinates.
    #[arg(long, num_args = 1.., value_name = "MESH")]
    pub mesh: Vec<PathBuf>,
}

#[derive(Clone, Copy, ValueEnum)]
pub enum AlbedoArg {
    /// The colours of the scan, which hold the light of the day of the scan.
    Rgb,
    /// The intensity of the scan.
    Intensity,
    /// One grey.
    Plain,
}

impl LightArgs {
    /// Source of colours: the albedo, or else what `--colour` names.
    pub fn colour_by(&self, colour: Option<String>) -> Option<String> {
        let albedo = self.albedo.map(|albedo| match albedo {
            AlbedoArg::Rgb => "rgb",
            AlbedoArg::Intensity => "intensity",
            AlbedoArg::Plain => "plain",
        });
        albedo.map(str::to_owned).or(colour)
    }

    /// Settings of the light, those of `base` where no option is given.
    pub fn over(&self, base: LightSettings) -> LightSettings {
        LightSettings {
            lights: joined(self.lights.clone()).or(base.lights),
            samples: self.samples.unwrap_or(base.samples),
            bounces: self.bounces.unwrap_or(base.bounces),
            shadow_samples: self.shadow_samples.unwrap_or(base.shadow_samples),
            filter: self.light_filter.unwrap_or(base.filter),
            filters_shadows: base.filters_shadows || self.filter_shadows,
            gloss: self.gloss.or(base.gloss),
            seed: self.seed.unwrap_or(base.seed),
            exposure: self.exposure.or(base.exposure),
            meshes: if self.mesh.is_empty() { base.meshes } else { self.mesh.clone() },
            factor: base.factor,
        }
    }

    /// Names of the options that are given.
    fn given(&self) -> Vec<&'static str> {
        let all = [
            (!self.lights.is_empty(), "--lights"),
            (self.samples.is_some(), "--samples"),
            (self.bounces.is_some(), "--bounces"),
            (self.shadow_samples.is_some(), "--shadow-samples"),
            (self.light_filter.is_some(), "--filter"),
            (self.filter_shadows, "--filter-shadows"),
            (self.gloss.is_some(), "--gloss"),
            (self.seed.is_some(), "--seed"),
            (self.albedo.is_some(), "--albedo"),
            (self.exposure.is_some(), "--exposure"),
            (!self.mesh.is_empty(), "--mesh"),
        ];
        all.into_iter().filter(|(is_given, _)| *is_given).map(|(_, name)| name).collect()
    }

    /// Refuses options without effect, and light in a program without it.
    ///
    /// # Errors
    /// If options are given to another method, or the program was built without light.
    pub fn check(&self, method: Method) -> Result<()> {
        if method == Method::Lit {
            return check_built();
        }
        let given = self.given();
        ensure!(given.is_empty(), "{} lights pictures: add --method lit", given.join(", "));
        Ok(())
    }
}

fn filter_parser() -> impl TypedValueParser<Value = FilterName> {
    let values = FILTERS.map(|(_, name, help)| PossibleValue::new(name).help(help));
    let parser = PossibleValuesParser::new(values);
    parser.try_map(|name| filter_of_name(&name).ok_or("no such filter"))
}
