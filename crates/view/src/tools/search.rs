//! Finds the point of the file that was clicked, on a thread, since that reads the disk.

use super::tool::{Clicked, Shown};
use eframe::egui::Context;
use esker_engine::calls::pick::{Picked, pick};
use glam::DVec2;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, TryRecvError, sync_channel};

/// A search for a point.
pub struct Search {
    found: Receiver<Result<Option<Picked>, String>>,
}

/// How far a search is.
pub enum Outcome {
    /// It goes on.
    Open,
    /// The point, if there is one at the place.
    Found(Option<Box<Picked>>),
    /// Why the file cannot be read.
    Failed(String),
}

impl Search {
    /// Starts to find the point at a place of a picture; repaints the window when it is found.
    pub fn start(ctx: &Context, seen: &Shown, clicked: Clicked) -> Self {
        let (sender, found) = sync_channel(1);
        let (file, shown) = (Arc::clone(&seen.file), Arc::clone(&seen.shown));
        let (ctx, view) = (ctx.clone(), seen.view);
        let at = clicked.at * DVec2::new(f64::from(view.width), f64::from(view.height));
        let depth = clicked.depth - seen.depth_offset;
        let work = move || {
            let picked = pick(&file, &view, at, depth, &shown);
            // The receiver is gone if another place was clicked.
            let _ = sender.send(picked.map_err(|error| format!("{error:#}")));
            ctx.request_repaint();
        };
        // Without a thread the channel is closed, which is reported.
        let _ = std::thread::Builder::new().name("esker-pick".into()).spawn(work);
        Self { found }
    }

    /// How far the search is.
    pub fn poll(&self) -> Outcome {
        match self.found.try_recv() {
            Ok(Ok(picked)) => Outcome::Found(picked.map(Box::new)),
            Ok(Err(fault)) => Outcome::Failed(fault),
            Err(TryRecvError::Empty) => Outcome::Open,
            Err(TryRecvError::Disconnected) => {
                Outcome::Failed("the thread that looks for the point has ended".into())
            }
        }
    }
}
