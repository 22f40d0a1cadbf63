//! The light of a document, from and to the settings of lit pictures.

use super::places::{named, placed};
use super::values::{decimal, in_field, joined as numbers};
use crate::io::quantity;
use crate::light::check_built;
#[cfg(feature = "light")]
use crate::light::lights;
use crate::light::settings::{
    BOUNCES, FILTERS, Gloss, LightSettings, Lights, SAMPLES, SHADOW_SAMPLES, filter_of_name,
};
use anyhow::{Context, Result, ensure};
use esker_scene::{LightItem, LightOptions};
use std::ops::RangeInclusive;
use std::path::Path;

/// Settings of the light of a document in `folder`.
pub(super) fn settings(form: &LightOptions, folder: &Path) -> Result<LightSettings> {
    let default = LightSettings::default();
    let count = |name: &str, value: Option<u32>, range: RangeInclusive<i64>, default: u32| {
        let value = value.unwrap_or(default);
        let (least, most) = (range.start(), range.end());
        let fits = range.contains(&i64::from(value));
        ensure!(fits, "`light.{name}`: is {value}, it must be within {least} and {most}");
        Ok(value)
    };
    let mut joined: Option<Lights> = None;
    for (i, item) in form.lights.iter().enumerate() {
        let more = in_field(format!("light.lights[{i}]"), lights_of(item, folder))?;
        joined = Some(match joined {
            Some(lights) => together(lights, more),
            None => more,
        });
    }
    let filter = form.filter.as_ref().map(|name| {
        let names = || FILTERS.map(|(_, name, _)| name).join(", ");
        filter_of_name(name).with_context(|| format!("`{name}` is none of {}", names()))
    });
    let gloss = form
        .gloss
        .as_ref()
        .map(|values| numbers(values).parse::<Gloss>().map_err(anyhow::Error::msg));
    let gloss = in_field("light.gloss", gloss.transpose())?;
    ensure!(
        gloss.is_none() || !form.filter_shadows,
        "`light.filter_shadows`: the shadows of surfaces with `gloss` are not filtered; remove one"
    );
    let exposure = form.exposure.map(|factor| quantity::exposure(&factor.to_string()));
    Ok(LightSettings {
        lights: joined,
        samples: count("samples", form.samples, SAMPLES, default.samples)?,
        bounces: count("bounces", form.bounces, BOUNCES, default.bounces)?,
        shadow_samples: count(
            "shadow_samples",
            form.shadow_samples,
            SHADOW_SAMPLES,
            default.shadow_samples,
        )?,
        filter: in_field("light.filter", filter.transpose())?.unwrap_or(default.filter),
        filters_shadows: form.filter_shadows,
        gloss,
        seed: form.seed.unwrap_or(default.seed),
        exposure: in_field("light.exposure", exposure.transpose())?,
        meshes: form.mesh.iter().map(|name| placed(name, folder)).collect(),
        factor: default.factor,
    })
}

/// The form of settings in a document in `folder`.
pub(super) fn form(settings: &LightSettings, folder: &Path) -> Result<LightOptions> {
    let default = LightSettings::default();
    let other = |value: u32, default: u32| (value != default).then_some(value);
    let meshes = settings.meshes.iter().map(|mesh| named(mesh, folder));
    Ok(LightOptions {
        lights: settings.lights.as_ref().map_or(Ok(Vec::new()), |lights| items(lights, folder))?,
        samples: other(settings.samples, default.samples),
        bounces: other(settings.bounces, default.bounces),
        shadow_samples: other(settings.shadow_samples, default.shadow_samples),
        filter: (settings.filter != default.filter).then(|| settings.filter.name().into()),
        filter_shadows: settings.filters_shadows,
        gloss: settings
            .gloss
            .map(|Gloss { reflectance, roughness }| [reflectance, roughness].map(decimal).to_vec()),
        seed: (settings.seed != default.seed).then_some(settings.seed),
        exposure: settings.exposure,
        mesh: meshes.collect::<Result<_>>()?,
    })
}

/// The lights of an item of a document.
#[cfg(feature = "light")]
fn lights_of(item: &LightItem, folder: &Path) -> Result<Lights> {
    check_built()?;
    match item {
        LightItem::Word(word) => lights::one_in(word, folder),
        LightItem::Data(data) => Lights::parse(&serde_json::to_string(data)?),
    }
}

#[cfg(feature = "light")]
fn together(lights: Lights, more: Lights) -> Lights {
    lights.with(more)
}

/// Items of a document: words where they mean the same light, else data. Lights keep their order,
/// which random numbers depend on.
#[cfg(feature = "light")]
fn items(lights: &Lights, folder: &Path) -> Result<Vec<LightItem>> {
    use crate::light::written::word;
    let data = |lights: Lights| -> Result<LightItem> {
        // By text, since it has the shortest decimals of single-precision numbers.
        let text = serde_json::to_string(&lights)?;
        ensure!(
            text.len() as u64 <= esker_scene::BYTES_MAX,
            "{}; name pictures of the sky by their files",
            esker_scene::SceneError::TooLong
        );
        Ok(LightItem::Data(serde_json::from_str(&text)?))
    };
    let mut items = Vec::new();
    for light in &lights.lights {
        items.push(match word(light, |path| named(path, folder))? {
            Some(word) => LightItem::Word(word),
            None => data(vec![light.clone()].into())?,
        });
    }
    if !lights.emissive.is_empty() {
        items.push(data(Lights { lights: Vec::new(), ..lights.clone() })?);
    }
    Ok(items)
}

#[cfg(not(feature = "light"))]
fn lights_of(_: &LightItem, _: &Path) -> Result<Lights> {
    check_built().map(|()| Lights)
}

#[cfg(not(feature = "light"))]
fn together(lights: Lights, _: Lights) -> Lights {
    lights
}

#[cfg(not(feature = "light"))]
fn items(_: &Lights, _: &Path) -> Result<Vec<LightItem>> {
    check_built().map(|()| Vec::new())
}
