//! Refines the tree of a lit scene while the view rests: rays get faster, and no frame waits. In: a
//! scene, by its number. Out: the same surfaces under a tree made by clustering (`meister2018`). A
//! thread of its own works with one core, so that tasks of frames never wait behind it.

use esker_trace::Scene;
use esker_trace::accel::Kind;
use std::thread::JoinHandle;

/// Memory that a splat takes while its scene is refined, in units of what it takes otherwise: there
/// are the boxes, the binary tree and the new tree beside the old one.
const MEMORY_FACTOR: u64 = 2;

/// A tree that is being made. Dropping it waits for the thread, a second for a million splats.
#[derive(Debug, Default)]
pub(crate) struct Refining {
    /// Number of the scene, and the thread, which returns a scene if it is better.
    running: Option<(u64, JoinHandle<Option<Scene>>)>,
    /// Number of the last scene that was refined, or could not be.
    done: u64,
}

impl Refining {
    /// The refined scene `number`, once, when it is ready; never waits. `is_at_rest`: whether to
    /// begin. Scenes of more than half of `splats_max` stay, since both trees take memory.
    pub(crate) fn poll(
        &mut self,
        scene: &Scene,
        number: u64,
        splats_max: u64,
        is_at_rest: bool,
    ) -> Option<Scene> {
        if let Some((of, thread)) = self.running.take_if(|(_, thread)| thread.is_finished()) {
            self.done = of;
            return thread.join().ok().flatten().filter(|_| of == number);
        }
        let fits = scene.splats() as u64 * MEMORY_FACTOR <= splats_max;
        let is_wanted = self.done != number && scene.kind() == Kind::Implicit && fits;
        if self.running.is_none() && is_wanted && is_at_rest {
            self.begin(scene.clone(), number);
        }
        None
    }

    fn begin(&mut self, mut scene: Scene, number: u64) {
        let work = move || {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(1).use_current_thread().build();
            let is_better = pool.ok()?.install(|| scene.refine());
            is_better.then_some(scene)
        };
        let thread = std::thread::Builder::new().name("esker-refine".into()).spawn(work);
        match thread {
            Ok(thread) => self.running = Some((number, thread)),
            // Without a thread the scene stays as it is.
            Err(_) => self.done = number,
        }
    }
}

impl Drop for Refining {
    fn drop(&mut self) {
        if let Some((_, thread)) = self.running.take() {
            // A panic has no consequences but that the tree is not there.
            let _ = thread.join();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use esker_render::Splat;
    use esker_trace::scene::SplatInput;
    use std::time::{Duration, Instant};

    fn scene() -> Scene {
        let at = |i: u32| [(i % 40) as f32, (i / 40) as f32, (i * i % 7) as f32];
        let of = |index| Splat {
            centre: at(index),
            radius: 1.0,
            normal: [0.0, 0.0, 1.0],
            colour: [0.5; 3],
            draw: 0,
            index,
        };
        let splats: Vec<Splat> = (0..1600).map(of).collect();
        Scene::new(SplatInput { splats: &splats, ..SplatInput::default() })
    }

    /// Polls at rest until the thread has ended.
    fn end(refining: &mut Refining, scene: &Scene, number: u64) -> Option<Scene> {
        let deadline = Instant::now() + Duration::from_secs(60);
        while refining.done == 0 && Instant::now() < deadline {
            let refined = refining.poll(scene, number, u64::MAX, true);
            if refined.is_some() {
                return refined;
            }
            std::thread::sleep(Duration::from_millis(1));
        }
        None
    }

    #[test]
    fn a_scene_at_rest_is_refined_once_and_a_newer_one_does_not_get_its_tree() {
        let scene = scene();
        let mut refining = Refining::default();
        assert!(refining.poll(&scene, 1, u64::MAX, false).is_none());
        assert!(refining.poll(&scene, 1, 3000, true).is_none());
        assert!(refining.running.is_none(), "it moves, or has no memory");
        let refined = end(&mut refining, &scene, 1).unwrap();
        assert_eq!((refined.kind(), refined.splats()), (Kind::Refined, scene.splats()));
        assert!(refining.poll(&scene, 1, u64::MAX, true).is_none() && refining.running.is_none());
        let mut refining = Refining::default();
        assert!(refining.poll(&scene, 1, u64::MAX, true).is_none());
        assert!(end(&mut refining, &scene, 2).is_none());
        assert_eq!(refining.done, 1);
    }
}
