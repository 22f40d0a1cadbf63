//! From afar a scan is as small as its picture says: a pinhole draws as many points as a parallel
//! view of the same size, although the cells of the octree are far larger than the scan where it
//! lies across a border of large ones.
#![allow(clippy::unwrap_used, reason = "tests may panic")]

use esker_engine::draw::scene::{PictureRequest, PictureScene, open};
use esker_points::task::Silent;
use std::path::PathBuf;

/// Points that a view of the file draws.
fn drawn(file: &esker_engine::Forest, camera: &str) -> f64 {
    let camera = camera.parse().unwrap();
    let request = PictureRequest { size: [240, 160], camera, ..PictureRequest::default() };
    PictureScene::choose(file, &request).unwrap().selection.counters.points as f64
}

#[test]
fn distant_pinholes_draw_as_many_points_as_parallel_views() {
    for scan in ["synthetic:office:300k:1", "synthetic:bridge:300k:1", "synthetic:terrain:300k:1"] {
        let (file, _folder) =
            open(&[PathBuf::from(scan)], &PictureRequest::default(), &Silent).unwrap();
        let [low, high] = file.bounds().unwrap().map(|corner| file.lattice().world(corner));
        let middle = [0, 1, 2].map(|i| f64::midpoint(low[i], high[i]));
        let size = (0..3).map(|i| (high[i] - low[i]).powi(2)).sum::<f64>().sqrt();
        for sizes in [3.0, 30.0, 1000.0] {
            let away = size * sizes;
            let eye = [middle[0] + 0.6 * away, middle[1] - 0.64 * away, middle[2] + 0.48 * away];
            let at = |p: [f64; 3]| format!("{:?},{:?},{:?}", p[0], p[1], p[2]);
            let place = format!("eye={};target={}", at(eye), at(middle));
            let height = 2.0 * away * 25f64.to_radians().tan();
            let pinhole = drawn(&file, &format!("{place};fovy=50"));
            let parallel = drawn(&file, &format!("{place};ortho={height:?}"));
            // Near parts of a scan are larger in perspective.
            let most = parallel * (1.0 + 2.0 / sizes) + 64.0;
            assert!(pinhole <= most, "{scan}, {sizes} sizes: {pinhole} and {parallel}");
            assert!(pinhole >= parallel * 0.5 - 64.0, "{scan}: {pinhole} and {parallel}");
        }
    }
}
