//! What pictures are compared with: the same view of all points, drawn at twice the resolution and
//! reduced in linear light; and the views of the alignments, which differ by fractions of a pixel,
//! so that no error depends on where pixels happen to lie.

use crate::error_time::analytic::Analytic;
use crate::error_time::perfect::{FINER, Reference};
use crate::error_time::settings::Setting;
use crate::render::scene::{Changes, ResidentScene};
use anyhow::Result;
use esker_engine::draw::scene::PictureRequest;
use esker_format::Forest;
use esker_lod::View;
use esker_points::Task;
use glam::DMat3;

/// Target of references, pixels of the reference: finer points would change nothing.
const SPACING_PX: f64 = 0.25;
/// Most points of a reference.
const POINTS_MAX: u64 = 64_000_000;
/// Shifts of the picture, pixels.
pub(super) const ALIGNMENTS: [[f64; 2]; 5] =
    [[0.0, 0.0], [0.5, 0.25], [-0.25, 0.5], [0.25, -0.5], [-0.5, -0.25]];

/// Turns the camera so that the picture moves by fractions of its pixels. `scale` is the side of
/// this picture over that of the shown one.
pub(super) fn aligned(view: &View, shift_px: [f64; 2], scale: f64) -> View {
    let [x, y] = shift_px.map(|shift| shift * scale / view.focal_px());
    let turn = DMat3::from_rotation_y(x) * DMat3::from_rotation_x(y);
    View { world_from_view: view.world_from_view * turn, ..*view }
}

/// What the pictures of all methods are compared with.
pub(super) enum Common<'a> {
    /// All points of a scan, drawn by EWA splatting.
    Points(Box<ReferenceScene<'a>>),
    /// Exact surfaces, and the shown view.
    Exact(&'a Analytic, View),
}

impl Common<'_> {
    /// Draws the reference of an alignment, after `turn` has changed the view.
    ///
    /// # Errors
    /// If the view makes no valid camera.
    pub fn draw(&mut self, shift_px: [f64; 2], turn: impl Fn(View) -> View) -> Result<Reference> {
        match self {
            Self::Points(scene) => scene.draw(shift_px, turn),
            Self::Exact(scene, view) => scene.picture(&turn(aligned(view, shift_px, 1.0))),
        }
    }

    /// Focal length of the shown picture, pixels.
    pub fn focal_px(&self) -> f64 {
        match self {
            Self::Points(scene) => scene.view.focal_px() / FINER as f64,
            Self::Exact(_, view) => view.focal_px(),
        }
    }

    /// Number of points that are drawn; none of exact surfaces.
    pub fn points(&self) -> Option<u64> {
        match self {
            Self::Points(scene) => Some(scene.scene.points()),
            Self::Exact(..) => None,
        }
    }
}

/// A scene from which the references of a method are drawn.
pub(super) struct ReferenceScene<'a> {
    scene: ResidentScene<'a>,
    view: View,
}

impl<'a> ReferenceScene<'a> {
    /// Reads all points that a reference by the method of `setting` shows.
    ///
    /// # Errors
    /// If planes cannot be read.
    pub fn new(
        file: &'a Forest,
        setting: &Setting,
        size: [u32; 2],
        base: &PictureRequest,
        task: &dyn Task,
    ) -> Result<Self> {
        let all = Setting {
            spacing_px: SPACING_PX,
            budget_points: POINTS_MAX,
            scale: 1.0,
            pass: None,
            full: true,
            ..setting.clone()
        };
        let request = all.request(size.map(|side| side * FINER as u32), base);
        let scene = ResidentScene::new(file, &request, None, task)?;
        let view = scene.picture.view;
        Ok(Self { scene, view })
    }

    /// Draws the reference of an alignment, after `turn` has changed the view.
    ///
    /// # Errors
    /// If the view makes no valid camera.
    pub fn draw(&mut self, shift_px: [f64; 2], turn: impl Fn(View) -> View) -> Result<Reference> {
        self.scene.picture.view = turn(aligned(&self.view, shift_px, FINER as f64));
        self.scene.on_cpu(Changes::NONE)?;
        Ok(Reference::of(self.scene.cpu_picture()))
    }
}
