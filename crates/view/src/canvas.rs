//! The picture as a texture of the window: the GPU renderer's own, which needs no copy through main
//! memory; or uploaded from the CPU renderer.

use eframe::egui::{
    Color32, ColorImage, Context, Rect, TextureHandle, TextureId, TextureOptions, Ui, pos2,
};
use eframe::egui_wgpu::RenderState;
use eframe::wgpu;
use esker_engine::Picture;

/// The texture that shows the newest picture.
#[derive(Default)]
pub struct Canvas {
    /// What paints the window, where that is a graphics driver.
    painter: Option<RenderState>,
    uploaded: Option<TextureHandle>,
    native: Option<(wgpu::TextureView, TextureId)>,
    shown: Option<TextureId>,
    size: [u32; 2],
}

impl Canvas {
    /// In a window that this paints; `None` where it is no graphics driver.
    pub fn new(painter: Option<RenderState>) -> Self {
        Self { painter, ..Self::default() }
    }

    /// Takes a picture from main memory.
    pub fn upload(&mut self, ctx: &Context, picture: &Picture) {
        let size = [picture.width as usize, picture.height as usize];
        // Alpha is whole everywhere, so that premultiplied is the same.
        let image = ColorImage::from_rgba_premultiplied(size, &picture.rgba);
        let texture = match &mut self.uploaded {
            Some(texture) => {
                texture.set(image, TextureOptions::LINEAR);
                texture
            }
            None => {
                self.uploaded.insert(ctx.load_texture("picture", image, TextureOptions::LINEAR))
            }
        };
        self.shown = Some(texture.id());
        self.size = [picture.width, picture.height];
    }

    /// Takes the renderer's own texture, of this size; false where the window is not painted by a
    /// graphics driver.
    pub fn show(&mut self, view: &wgpu::TextureView, size: [u32; 2]) -> bool {
        let Some(painter) = &self.painter else { return false };
        let filter = wgpu::FilterMode::Linear;
        let id = match &self.native {
            Some((last, id)) if last == view => *id,
            Some((_, id)) => {
                let mut renderer = painter.renderer.write();
                renderer.update_egui_texture_from_wgpu_texture(&painter.device, view, filter, *id);
                *id
            }
            None => {
                let mut renderer = painter.renderer.write();
                renderer.register_native_texture(&painter.device, view, filter)
            }
        };
        self.native = Some((view.clone(), id));
        self.shown = Some(id);
        self.size = size;
        true
    }

    /// Size of the picture, pixels; zeros where there is none yet.
    pub fn size(&self) -> [u32; 2] {
        self.size
    }

    /// Paints it over this place, where there is any.
    pub fn paint(&self, ui: &Ui, place: Rect) {
        let Some(texture) = self.shown else { return };
        let whole = Rect::from_min_max(pos2(0.0, 0.0), pos2(1.0, 1.0));
        ui.painter().image(texture, place, whole, Color32::WHITE);
    }
}
