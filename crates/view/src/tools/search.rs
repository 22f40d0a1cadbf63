//! Finds the points of the file that were clicked, on a thread, since that reads the disk.

use crate::gestures::Clicked;
use eframe::egui::Context;
use esker_engine::calls::pick::{Picked, pick};
use esker_engine::{Forest, ForestFilter, View};
use glam::DVec2;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, TryRecvError, sync_channel};

/// A point that is being found.
pub struct Picking {
    found: Receiver<Result<Option<Picked>, String>>,
}

/// How far a search is.
pub enum Search {
    /// It goes on.
    Open,
    /// The point, if there is one at the place.
    Found(Option<Box<Picked>>),
    /// Why the file cannot be read.
    Failed(String),
}

impl Picking {
    /// Starts to find the point at a place of the picture of `view`, among those that `shown`
    /// accepts; repaints the window when it is found.
    pub fn start(
        ctx: &Context,
        file: Arc<Forest>,
        view: View,
        clicked: Clicked,
        shown: Arc<ForestFilter>,
    ) -> Self {
        let (sender, found) = sync_channel(1);
        let ctx = ctx.clone();
        let at = clicked.at * DVec2::new(f64::from(view.width), f64::from(view.height));
        let work = move || {
            let picked = pick(&file, &view, at, clicked.depth, &shown);
            // The receiver is gone if another place was clicked.
            let _ = sender.send(picked.map_err(|error| format!("{error:#}")));
            ctx.request_repaint();
        };
        // Without a thread the channel is closed, which is reported.
        let _ = std::thread::Builder::new().name("esker-pick".into()).spawn(work);
        Self { found }
    }

    /// How far the search is.
    pub fn poll(&self) -> Search {
        match self.found.try_recv() {
            Ok(Ok(picked)) => Search::Found(picked.map(Box::new)),
            Ok(Err(fault)) => Search::Failed(fault),
            Err(TryRecvError::Empty) => Search::Open,
            Err(TryRecvError::Disconnected) => {
                Search::Failed("the thread that looks for the point has ended".into())
            }
        }
    }
}
