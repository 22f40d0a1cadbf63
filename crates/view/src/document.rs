//! Scene documents in the window: what a document says becomes settings and the first view, and the
//! settings and the camera become a document again. Files that are opened without a document have
//! one in memory, so that it can be saved.

use crate::args::Args;
use crate::settings::Settings;
use anyhow::Result;
use esker_engine::cameras::camera::Camera as CameraRequest;
use esker_engine::cameras::vertical::Vertical;
use esker_engine::document::{self, Annotation, Document, Measurement};
use esker_engine::draw::scene::{PictureRequest, open_together};
use esker_engine::io::output::folder_of;
use esker_engine::light::settings::{LightSettings, SAMPLES_FINAL};
use esker_engine::{BuildOptions, Dots, Filter, Forest, Method};
use std::path::{Path, PathBuf};

/// What is open, as a scene document names it.
#[derive(Clone, Debug)]
pub struct SceneFile {
    /// The inputs of the window.
    inputs: Vec<PathBuf>,
    /// The document, if there is a file of it.
    document: Option<Document>,
    /// Its picture; without a document, that of `esker render` without options.
    request: PictureRequest,
    /// Clouds of the document that are open, in the order of the open file; empty if they are not
    /// shown and hidden one by one.
    clouds: Vec<usize>,
    /// Clouds of the open file that the document hides.
    hidden: Vec<usize>,
    /// What is left out.
    note: Option<String>,
}

/// What the window shows, as a document has it.
#[derive(Debug)]
pub struct Present {
    /// Settings.
    pub settings: Settings,
    /// The view, in the scan's coordinates.
    pub camera: CameraRequest,
    /// Size of the picture, pixels.
    pub size: [u32; 2],
    /// All measurements.
    pub measurements: Vec<Measurement>,
}

/// Outcome of saving.
#[derive(Debug)]
pub enum Saved {
    /// The document as it was written.
    Written(Box<SceneFile>),
    /// Nothing was written: there is another file of this name.
    Exists(PathBuf),
}

impl SceneFile {
    /// The document among the inputs of the window; if there is none, one of them.
    ///
    /// # Errors
    /// If a document cannot be read, has invalid values, or is not the only input.
    pub fn of(inputs: &[PathBuf]) -> Result<Self> {
        let document = Document::among(inputs)?;
        let request = match &document {
            Some(document) => document.request()?,
            None => PictureRequest::of_options(),
        };
        let (clouds, hidden, note) = (Vec::new(), Vec::new(), None);
        Ok(Self { inputs: inputs.to_vec(), document, request, clouds, hidden, note })
    }

    /// Opens the clouds, if they are `.esker` files: also those that are not visible, so that they
    /// can be shown, unless they do not open together with the others.
    ///
    /// # Errors
    /// If a visible cloud cannot be opened, or they do not lie on one lattice.
    pub fn open(&mut self) -> Result<Option<Forest>> {
        let Some(document) = &self.document else {
            let file = open_together(&self.inputs, &[])?;
            self.clouds = (0..file.as_ref().map_or(0, Forest::clouds)).collect();
            return Ok(file);
        };
        let clouds = document.clouds();
        let hidden = clouds.iter().enumerate().filter(|(_, cloud)| !cloud.is_visible);
        let hidden: Vec<usize> = hidden.map(|(i, _)| i).collect();
        if !hidden.is_empty() {
            let (paths, offsets): (Vec<PathBuf>, Vec<[f64; 3]>) =
                clouds.iter().map(|cloud| (cloud.path.clone(), cloud.offset)).unzip();
            match open_together(&paths, &offsets) {
                Ok(Some(file)) => {
                    (self.clouds, self.hidden) = ((0..clouds.len()).collect(), hidden);
                    return Ok(Some(file));
                }
                Ok(None) => {}
                Err(error) => {
                    self.note = Some(format!("hidden clouds are not open: {error:#}"));
                }
            }
        }
        let file = open_together(&document.inputs()?, &self.request.offsets)?;
        if file.is_some() {
            self.clouds = (0..clouds.len()).filter(|&i| clouds[i].is_visible).collect();
        }
        Ok(file)
    }

    /// The scans to build, if the clouds are scans.
    ///
    /// # Errors
    /// If no cloud of the document is visible.
    pub fn scans(&self) -> Result<Vec<PathBuf>> {
        self.document.as_ref().map_or_else(|| Ok(self.inputs.clone()), Document::inputs)
    }

    /// How the scans are built, with the memory and the scratch folder of `machine`.
    pub fn build_options(&self, machine: &BuildOptions) -> BuildOptions {
        let BuildOptions { memory_bytes, scratch, .. } = machine.clone();
        match &self.document {
            Some(_) => BuildOptions { memory_bytes, scratch, ..self.request.build_options() },
            None => machine.clone(),
        }
    }

    /// The path of the document, if there is a file of it.
    pub fn path(&self) -> Option<&Path> {
        self.document.as_ref().map(|document| document.path.as_path())
    }

    /// Clouds of the open file that the document hides.
    pub fn hidden(&self) -> &[usize] {
        &self.hidden
    }

    /// Names of the clouds of the open file, if it has several.
    pub fn names(&self) -> Vec<String> {
        let clouds = match &self.document {
            Some(document) => document.clouds().into_iter().map(|cloud| cloud.path).collect(),
            None => self.inputs.clone(),
        };
        let name = |&cloud: &usize| {
            let path: &PathBuf = clouds.get(cloud)?;
            Some(path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned())
        };
        self.clouds.iter().filter_map(name).collect()
    }

    /// Clouds that are not open although the document has them.
    pub fn note(&self) -> Option<&str> {
        self.note.as_deref()
    }

    /// Measurements of the document.
    pub fn measurements(&self) -> &[Measurement] {
        self.document.as_ref().map_or(&[], |document| &document.scene.measurements)
    }

    /// Annotations of the document.
    pub fn annotations(&self) -> &[Annotation] {
        self.document.as_ref().map_or(&[], |document| &document.scene.annotations)
    }

    /// Settings of the document, with those of the command line in place of its own; the budgets of
    /// memory are those of `present`. Without a document, the present ones.
    pub fn settings(&self, args: &Args, present: &Settings) -> Settings {
        let Some(_) = &self.document else { return present.clone() };
        let hidden_clouds = self.hidden.clone();
        Settings { hidden_clouds, ..settings(args, &self.request, present) }
    }

    /// The first view, with that of the command line in place of its own.
    pub fn camera(&self, args: &Args) -> CameraRequest {
        let own = self.request.camera;
        let camera = if args.camera == CameraRequest::default() { own } else { args.camera };
        CameraRequest { up: args.up.map(Vertical::direction).or(camera.up), ..camera }
    }

    /// The present state as a document at `out`, which is written; what the document has beside it
    /// is kept. A document that is a file keeps its size of pictures and its samples of light,
    /// another one gets those of the window. Waits for the disk.
    ///
    /// # Errors
    /// If the document cannot be made or written, or would replace a file of another kind.
    pub fn save(mut self, out: &Path, may_replace: bool, present: &Present) -> Result<Saved> {
        let is_unchanged = |document: &Document| {
            let is_own = out.canonicalize().ok() == document.path.canonicalize().ok();
            is_own && Document::read(out).is_ok_and(|read| read.scene == document.scene)
        };
        let may_replace = may_replace || self.document.as_ref().is_some_and(is_unchanged);
        if !may_replace && out.symlink_metadata().is_ok() {
            return Ok(Saved::Exists(out.to_owned()));
        }
        let settings = &present.settings;
        let size = if self.document.is_some() { self.request.size } else { present.size };
        self.request = request(&self.request, settings, present.camera, size);
        if self.document.is_none() && settings.method == Method::Lit {
            self.request.light.samples = SAMPLES_FINAL;
        }
        let mut document = match self.document.take() {
            Some(document) => document,
            None => Document::of_inputs(&self.inputs)?,
        };
        for (i, &cloud) in self.clouds.iter().enumerate() {
            if let Some(cloud) = document.scene.clouds.get_mut(cloud) {
                cloud.visible = !settings.hidden_clouds.contains(&i);
            }
        }
        document.scene.measurements.clone_from(&present.measurements);
        let read: Vec<PathBuf> = document.clouds().into_iter().map(|cloud| cloud.path).collect();
        document::save_over(out, &read, &document, &self.request)?;
        self.document = Some(Document::read(out)?);
        Ok(Saved::Written(Box::new(self)))
    }

    /// Path of the document; without one, beside the first input.
    pub fn place(&self) -> PathBuf {
        if let Some(path) = self.path() {
            return path.to_owned();
        }
        let first = self.inputs.first().map_or(Path::new("scan"), PathBuf::as_path);
        let stem = first.file_stem().map_or("scan".into(), |stem| stem.to_string_lossy());
        // The names of generated scans have colons, which not all systems have in names of files.
        folder_of(first).join(format!("{}.scene.json", stem.replace(':', "-")))
    }
}

/// Settings of a picture, with those of the command line in place of its own, and the budgets of
/// memory of `present`.
pub fn settings(args: &Args, base: &PictureRequest, present: &Settings) -> Settings {
    let (light, own) = (&base.light, args.light());
    Settings {
        method: args.method.unwrap_or(base.method),
        colour_by: args.colour.clone().or_else(|| base.colour_by.clone()),
        // Set when the file is open.
        vertical: Vertical::default(),
        filter: filter_over(args.filter(), &base.filter),
        hidden_clouds: Vec::new(),
        shines: base.shines && !args.no_highlights,
        light: LightSettings {
            lights: own.lights.as_ref().or(light.lights.as_ref()).cloned(),
            filters_shadows: own.filters_shadows || (light.filters_shadows && own.gloss.is_none()),
            gloss: own.gloss.or(light.gloss.filter(|_| !own.filters_shadows)),
            ..light.clone()
        },
        evens_exposure: base.evens_exposure || args.even_exposure,
        culls_back: base.culls_back || args.cull_back,
        dots: Dots {
            size: args.point_size.unwrap_or(base.dots.size),
            eye_dome: args.eye_dome.unwrap_or(base.dots.eye_dome),
        },
        full: base.full || args.full,
        points_budget: args.budget_points.unwrap_or(base.budget_points),
        target_spacing_px: args.target_spacing.unwrap_or(base.target_spacing_px),
        budget_gpu_bytes: present.budget_gpu_bytes,
        budget_ram_bytes: present.budget_ram_bytes,
        occlusion: present.occlusion,
    }
}

/// A filter with the conditions of `own` in place of those of `base`.
fn filter_over(own: Filter, base: &Filter) -> Filter {
    let flags = |own: esker_engine::Flags, base| if own.is_empty() { base } else { own };
    Filter {
        bounds: own.bounds.or(base.bounds),
        polygon: own.polygon.or_else(|| base.polygon.clone()),
        clips: if own.clips.is_empty() { base.clips.clone() } else { own.clips },
        classes: own.classes.or(base.classes),
        flags: flags(own.flags, base.flags),
        without_flags: flags(own.without_flags, base.without_flags),
        values: if own.values.is_empty() { base.values.clone() } else { own.values },
        max_spacing: own.max_spacing.or(base.max_spacing),
    }
}

/// The request of the picture that the window shows; what the window does not change is that of
/// `base`.
fn request(
    base: &PictureRequest,
    settings: &Settings,
    camera: CameraRequest,
    size: [u32; 2],
) -> PictureRequest {
    PictureRequest {
        size,
        method: settings.method,
        camera,
        budget_points: settings.points_budget,
        target_spacing_px: settings.target_spacing_px,
        colour_by: settings.colour_by.clone(),
        filter: settings.filter.clone(),
        shines: settings.shines,
        evens_exposure: settings.evens_exposure,
        culls_back: settings.culls_back,
        dots: settings.dots,
        full: settings.full,
        light: settings.light.clone(),
        ..base.clone()
    }
}

#[cfg(test)]
mod tests;
