//! The picture as a texture of egui: the texture of the GPU renderer itself, which is not copied
//! through main memory, or one that is uploaded from the CPU renderer.

use eframe::egui::{
    Color32, ColorImage, Context, Rect, TextureHandle, TextureId, TextureOptions, Ui, pos2,
};
use eframe::egui_wgpu::RenderState;
use eframe::wgpu;
use esker_engine::Picture;

/// The texture that shows the newest picture.
#[derive(Default)]
pub struct Canvas {
    /// Device and renderer of egui, if a graphics driver paints the window.
    driver: Option<RenderState>,
    uploaded: Option<TextureHandle>,
    native: Option<(wgpu::TextureView, TextureId)>,
    shown: Option<TextureId>,
    size: [u32; 2],
}

impl Canvas {
    /// Makes a canvas; `driver` is `None` if the CPU paints the window.
    pub fn new(driver: Option<RenderState>) -> Self {
        Self { driver, ..Self::default() }
    }

    /// Uploads a picture from main memory.
    pub fn upload(&mut self, ctx: &Context, picture: &Picture) {
        let size = [picture.width as usize, picture.height as usize];
        // Alpha is 255 everywhere, so that premultiplied colours are the same.
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

    /// Shows the renderer's own texture, of `size` pixels. Returns false if no graphics driver
    /// paints the window.
    pub fn show(&mut self, view: &wgpu::TextureView, size: [u32; 2]) -> bool {
        let Some(driver) = &self.driver else { return false };
        let filter = wgpu::FilterMode::Linear;
        let id = match &self.native {
            Some((last, id)) if last == view => *id,
            Some((_, id)) => {
                let mut renderer = driver.renderer.write();
                renderer.update_egui_texture_from_wgpu_texture(&driver.device, view, filter, *id);
                *id
            }
            None => {
                let mut renderer = driver.renderer.write();
                renderer.register_native_texture(&driver.device, view, filter)
            }
        };
        self.native = Some((view.clone(), id));
        self.shown = Some(id);
        self.size = size;
        true
    }

    /// Size of the picture, pixels; zeros before the first picture.
    pub fn size(&self) -> [u32; 2] {
        self.size
    }

    /// Paints the picture over `rect`, if there is one.
    pub fn paint(&self, ui: &Ui, rect: Rect) {
        let Some(texture) = self.shown else { return };
        let whole = Rect::from_min_max(pos2(0.0, 0.0), pos2(1.0, 1.0));
        ui.painter().image(texture, rect, whole, Color32::WHITE);
    }
}
