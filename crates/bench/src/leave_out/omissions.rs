//! The things that pictures of a file can do without, each with the picture that has it and the one
//! that does not. Some apply to dense views only; these are drawn at the largest size at which the
//! view is dense, and from farther away if it is dense at no size.

use crate::leave_out::pictures::LeftOutBy;
use crate::render::scene::Changes;
use anyhow::Result;
use esker_engine::Method;
use esker_engine::calls::info;
use esker_engine::cameras::camera::Camera;
use esker_engine::cameras::colour;
use esker_engine::draw::scene::{PictureRequest, PictureScene};
use esker_format::{Forest, PlaneKind};
use esker_points::Filter;
use esker_points::attribute::names;
use esker_points::filter::Bounds;
use esker_render::{FramePlan, Pass};

/// Target spacing at which views are dense, pixels.
pub(super) const DENSE_PX: f64 = 0.3;
/// Target spacing at which points do not share pixels, pixels.
const SPARSE_PX: f64 = 1.5;
/// Shorter side of the smallest picture in which a dense view is looked for, pixels.
const SIDE_MIN: u32 = 16;

/// A thing that can be left out: a picture with it, and one without.
pub(super) struct Omission {
    /// Name in reports.
    pub name: &'static str,
    /// The picture that has it, and how its frames are changed.
    pub with: (PictureRequest, Changes),
    /// The picture that has it not, and how its frames are changed.
    pub without: (PictureRequest, Changes),
    /// Who leaves it out.
    pub by: LeftOutBy,
}

impl Omission {
    /// An omission that needs another picture, and no changes of frames.
    fn of_pictures(name: &'static str, with: PictureRequest, without: PictureRequest) -> Self {
        let unchanged = Changes::NONE;
        let by = LeftOutBy::Request;
        Self { name, with: (with, unchanged), without: (without, unchanged), by }
    }

    /// An omission that changes frames of the same picture.
    fn of_changes(
        name: &'static str,
        picture: PictureRequest,
        with: Changes,
        without: Changes,
    ) -> Self {
        let by = LeftOutBy::Request;
        Self { name, with: (picture.clone(), with), without: (picture, without), by }
    }

    /// The same, left out by `by`.
    fn by(self, by: LeftOutBy) -> Self {
        Self { by, ..self }
    }
}

/// Lists what can be left out of pictures of `file`. `base` has full planes and one colour.
///
/// # Errors
/// If statistics cannot be read.
pub(super) fn omissions(file: &Forest, base: &PictureRequest) -> Result<Vec<Omission>> {
    let mut all = colours(file, base);
    all.extend(normals(file, base));
    all.extend(mapped_values(file, base));
    all.extend(sparse_views(file, base));
    all.extend(dense_views(file, base)?);
    all.extend(coverage(file, base));
    Ok(all)
}

/// Highlights and colours.
fn colours(file: &Forest, base: &PictureRequest) -> Vec<Omission> {
    let coloured = |name: &str| PictureRequest { colour_by: Some(name.into()), ..base.clone() };
    let matt = PictureRequest { shines: false, ..base.clone() };
    let mut all = vec![Omission::of_pictures("highlights", base.clone(), matt)];
    let planes = [(PlaneKind::Colour, "rgb"), (PlaneKind::Intensity, names::INTENSITY)];
    if let Some((_, name)) = planes.into_iter().find(|&(kind, _)| file.has(kind)) {
        all.push(Omission::of_pictures("colour plane", coloured(name), base.clone()));
    }
    if file.palette().is_some() {
        let full = coloured("rgb");
        let compact = PictureRequest { full: false, ..full.clone() };
        all.push(Omission::of_pictures("colours beyond a palette", full, compact));
    }
    if file.has(PlaneKind::Colour) && colour::scans(file).is_ok() {
        let evened = PictureRequest { evens_exposure: true, ..coloured("rgb") };
        all.push(Omission::of_pictures("exposure compensation", evened, coloured("rgb")));
    }
    all
}

/// The plane of normals, and culling by it.
fn normals(file: &Forest, base: &PictureRequest) -> Vec<Omission> {
    let mut all = Vec::new();
    if file.has(PlaneKind::Normal) {
        let plain = PictureRequest { method: Method::Points, ..base.clone() };
        let normals = PictureRequest { colour_by: Some("normal".into()), ..plain.clone() };
        all.push(Omission::of_pictures("normal plane of points alone", normals, plain));
    }
    if file.has_oriented_normals() && !file.is_closed() {
        let culled = PictureRequest { culls_back: true, ..base.clone() };
        all.push(Omission::of_pictures("back faces", base.clone(), culled));
    }
    all
}

/// Values of an attribute that are finer than the codes of a colour map.
fn mapped_values(file: &Forest, base: &PictureRequest) -> Option<Omission> {
    colour::colouring(file, Some(names::GPS_TIME), info::bounds(file)).ok()?;
    let codes = PictureRequest { colour_by: Some(names::GPS_TIME.into()), ..base.clone() };
    let values = PictureRequest { keeps_values: true, ..codes.clone() };
    Some(Omission::of_pictures("values beyond a byte of code", values, codes).by(LeftOutBy::Rule))
}

/// What views need in which points do not share pixels.
fn sparse_views(file: &Forest, base: &PictureRequest) -> Vec<Omission> {
    let sparse = PictureRequest { target_spacing_px: SPARSE_PX, ..base.clone() };
    let unchanged = Changes::NONE;
    let mut all = vec![Omission::of_changes(
        "smoothing of pixels that show one point",
        sparse.clone(),
        unchanged,
        Changes { is_rough: true, ..unchanged },
    )];
    if !file.has(PlaneKind::Normal) {
        let flat = Changes { is_flat: true, ..unchanged };
        all.push(Omission::of_changes("planes fitted to depths", sparse, unchanged, flat));
    }
    all
}

/// What dense and crowded views need, or do not.
fn dense_views(file: &Forest, base: &PictureRequest) -> Result<Vec<Omission>> {
    let fine =
        PictureRequest { target_spacing_px: DENSE_PX, budget_points: u64::MAX, ..base.clone() };
    let unchanged = Changes::NONE;
    let crowded = largest(file, &fine, FramePlan::averages)?;
    let one_wins = Changes { one_wins: true, ..unchanged };
    let dense = largest(file, &fine, |plan| !plan.passes.contains(&Pass::Push))?;
    let pushed = Changes { always_pushes: true, ..unchanged };
    Ok(vec![
        Omission::of_changes(
            "means of the points that share a pixel",
            crowded,
            unchanged,
            one_wins,
        ),
        Omission::of_changes("pull and push of a dense view", dense, pushed, unchanged)
            .by(LeftOutBy::Rule),
    ])
}

/// Closed surfaces, and points outside a box.
fn coverage(file: &Forest, base: &PictureRequest) -> Vec<Omission> {
    let points = PictureRequest { method: Method::Points, ..base.clone() };
    let mut all = vec![Omission::of_pictures("surfaces: points alone", base.clone(), points)];
    if let Some(bounds) = quarter(file) {
        let filter = Filter { bounds: Some(bounds), ..Filter::default() };
        let whole = PictureRequest { camera: fixed(file, base), ..base.clone() };
        let filtered = PictureRequest { filter, ..whole.clone() };
        all.push(Omission::of_pictures("what lies outside a box", whole, filtered));
    }
    all
}

/// Halves a picture until `is_so` holds of its plan, first from the camera of `picture`, then from
/// farther away; returns it unchanged if `is_so` holds at no size.
pub(super) fn largest(
    file: &Forest,
    picture: &PictureRequest,
    is_so: fn(&FramePlan) -> bool,
) -> Result<PictureRequest> {
    let away = PictureRequest { camera: farther(file, picture), ..picture.clone() };
    for mut smaller in [picture.clone(), away] {
        while smaller.size.into_iter().min() >= Some(SIDE_MIN) {
            if is_so(&PictureScene::choose(file, &smaller)?.plan) {
                return Ok(smaller);
            }
            // The same points, drawn smaller.
            smaller.size = smaller.size.map(|side| side / 2);
            smaller.target_spacing_px /= 2.0;
        }
    }
    Ok(picture.clone())
}

/// A picture's camera, moved back by the diagonal of the file's bounds: nothing is near the eye.
fn farther(file: &Forest, picture: &PictureRequest) -> Camera {
    let bounds = info::bounds(file);
    let view = picture.camera.measured(file.lattice()).view(bounds, picture.size);
    let extent: f64 = (0..3).map(|i| (bounds[1][i] - bounds[0][i]).powi(2)).sum();
    let eye = view.eye - view.forward() * extent.sqrt();
    let target = Some(eye + view.forward());
    Camera { eye: Some(eye), target, ..picture.camera }.unmeasured(file.lattice())
}

/// A picture's camera with an eye, so that a filter does not move it.
fn fixed(file: &Forest, picture: &PictureRequest) -> Camera {
    let camera = picture.camera.measured(file.lattice());
    let view = camera.view(info::bounds(file), picture.size);
    let target = Some(view.eye + view.forward());
    Camera { eye: Some(view.eye), target, ..picture.camera }.unmeasured(file.lattice())
}

/// The middle quarter of a file seen from above; `None` if its bounds are flat.
fn quarter(file: &Forest) -> Option<Bounds> {
    let [low, high] = info::world_bounds(file)?;
    let at = |axis: usize, share: f64| low[axis] + (high[axis] - low[axis]) * share;
    let bounds = Bounds {
        min: [at(0, 0.25), at(1, 0.25), f64::NEG_INFINITY],
        max: [at(0, 0.75), at(1, 0.75), f64::INFINITY],
    };
    (0..2).all(|axis| bounds.min[axis] < bounds.max[axis]).then_some(bounds)
}
