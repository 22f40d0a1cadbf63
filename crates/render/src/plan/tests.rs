//! Claims about plans: which options and planes of a scene lead to which passes, planes and
//! variants.

use super::*;
use crate::inputs::colour::{Codebook, Gradient};

const ALL: SceneHas = SceneHas {
    normals: true,
    oriented_normals: true,
    colour_plane: true,
    hidden_points: false,
    clip_lines: false,
    tangents: false,
};
const OPTIONS: FrameOptions = FrameOptions {
    method: Method::PullPush,
    colour: ColourBy::Rgb,
    shines: true,
    sparsest_px: 2.0,
    smooths: true,
    fits_planes: true,
    crowding: 0.0,
    evens_exposure: false,
    dots: Dots { size: PointSize::Pixels(1.0), eye_dome: 0.0 },
    mixes_dots: false,
    thins_points: false,
    passes: PassChoice { skipped: PassSet::of(&[]), forced: PassSet::of(&[]) },
};

#[test]
fn without_normals_none_are_read_carried_or_tested() {
    let plan = FramePlan::of(&SceneHas { normals: false, ..ALL }, &OPTIONS);
    assert!(!plan.reads_normals && !plan.carries_normals && !plan.culls_back_faces);
    let constants = plan.variants().into_iter().flat_map(|v| v.constants);
    let flags = ["NORMALS", "CULLS_BACK_FACES"];
    assert!(constants.into_iter().all(|(name, value)| !flags.contains(&name) || value == 0));
}

#[test]
fn points_read_the_plane_of_their_colours_and_nothing_else() {
    let points = FrameOptions { method: Method::Points, ..OPTIONS };
    let has = SceneHas { oriented_normals: false, ..ALL };
    let reads = |colour| {
        let plan = FramePlan::of(&has, &FrameOptions { colour, ..points });
        assert!(!plan.carries_normals && !plan.has_pyramid && !plan.shines);
        (plan.reads_colours, plan.reads_normals, plan.fetches)
    };
    assert_eq!(reads(ColourBy::Rgb), (true, false, [false, true, false]));
    assert_eq!(reads(ColourBy::Plain), (false, false, [false; 3]));
    assert_eq!(reads(ColourBy::Normal), (false, true, [false, false, true]));
    let codes = ColourBy::Codes(Codebook::Along(Gradient::Viridis));
    assert_eq!(reads(codes), (true, false, [false, true, false]));
    assert_eq!(*FramePlan::of(&has, &points).passes, [Pass::Project, Pass::Resolve]);
}

#[test]
fn dots_and_eye_domes_are_for_points_alone() {
    let of = |size, eye_dome| FrameOptions { dots: Dots { size, eye_dome }, ..OPTIONS };
    let (wide, adaptive) = (of(PointSize::Pixels(3.0), 1.0), of(PointSize::Adaptive, 0.0));
    for (options, fetches_places) in [(wide, false), (adaptive, true)] {
        let surface = FramePlan::of(&ALL, &options);
        assert_eq!((surface.passes, surface.adapts), (FramePlan::of(&ALL, &OPTIONS).passes, false));
        let plan = FramePlan::of(&ALL, &FrameOptions { method: Method::Points, ..options });
        assert_eq!(plan.fetches[0], fetches_places);
        let lit = [Pass::EyeDome].into_iter().filter(|_| options.dots.eye_dome > 0.0);
        let all = [Pass::Project, Pass::Grow, Pass::Resolve].into_iter().chain(lit);
        assert_eq!(*plan.passes, *all.collect::<Vec<_>>());
    }
}

#[test]
fn surfaces_are_mixed_with_dots_on_request() {
    let dots = Dots { size: PointSize::Adaptive, eye_dome: 0.5 };
    let mixed = FrameOptions { mixes_dots: true, dots, ..OPTIONS };
    let plan = FramePlan::of(&ALL, &mixed);
    assert!(plan.mixes_dots() && plan.adapts && plan.fetches[0]);
    let surface = FramePlan::of(&ALL, &OPTIONS).passes;
    let of_dots = [Pass::Split, Pass::Grow, Pass::Overlay, Pass::EyeDome];
    let (own, shared): (Vec<_>, Vec<_>) = plan.passes.iter().partition(|p| of_dots.contains(p));
    assert_eq!((own, shared), (of_dots.iter().collect(), surface.iter().collect()));
    let constants = |shader: &str| {
        let variants = plan.variants().into_iter().filter(|v| v.shader == shader);
        variants.map(|v| v.constants).next()
    };
    assert_eq!(constants("grow/sizes"), Some(vec![("SPLITS", 1), ("NORMALS", 1)]));
    assert_eq!(constants("eye_dome"), Some(vec![("DOTS_ONLY", 1)]));
    for method in [Method::Points, Method::Ewa] {
        let others = FrameOptions { method, ..mixed };
        assert!(!FramePlan::of(&ALL, &others).mixes_dots(), "{method:?}");
    }
}

#[test]
fn only_splats_of_a_scene_with_clip_lines_and_normals_are_clipped() {
    let ewa = FrameOptions { method: Method::Ewa, ..OPTIONS };
    let has = SceneHas { clip_lines: true, ..ALL };
    let clips = |has: &SceneHas, options: &FrameOptions| {
        let plan = FramePlan::of(has, options);
        let variants = plan.variants().into_iter().flat_map(|v| v.constants);
        assert_eq!(plan.clips, variants.into_iter().any(|c| c == ("CLIPS", 1)));
        plan.clips
    };
    assert!(clips(&has, &ewa));
    assert!(!clips(&ALL, &ewa) && !clips(&has, &OPTIONS));
    assert!(!clips(&SceneHas { normals: false, ..has }, &ewa));
}

#[test]
fn only_splats_of_a_scene_with_tangents_and_normals_have_shapes() {
    let ewa = FrameOptions { method: Method::Ewa, ..OPTIONS };
    let has = SceneHas { tangents: true, ..ALL };
    let shapes = |has: &SceneHas, options: &FrameOptions| {
        let plan = FramePlan::of(has, options);
        let variants = plan.variants().into_iter().flat_map(|v| v.constants);
        assert_eq!(plan.tangents, variants.into_iter().any(|c| c == ("TANGENTS", 1)));
        plan.tangents
    };
    assert!(shapes(&has, &ewa));
    assert!(!shapes(&ALL, &ewa) && !shapes(&has, &OPTIONS));
    assert!(!shapes(&SceneHas { normals: false, ..has }, &ewa));
}

#[test]
fn dense_views_are_neither_pulled_nor_pushed() {
    let plan = FramePlan::of(&ALL, &FrameOptions { sparsest_px: 0.4, ..OPTIONS });
    assert!(!plan.has_pyramid);
    assert!(!plan.passes.contains(&Pass::Pull) && !plan.passes.contains(&Pass::Push));
    assert!(FramePlan::of(&ALL, &OPTIONS).has_pyramid);
}

#[test]
fn points_are_averaged_where_they_crowd_and_nowhere_else() {
    let crowded = FrameOptions { crowding: 1.0, ..OPTIONS };
    let plan = FramePlan::of(&ALL, &crowded);
    assert!(plan.averages() && plan.averages_read() == [true; 2]);
    assert!(plan.variants().iter().any(|v| v.shader == "average/add"));
    let dense = FramePlan::of(&ALL, &FrameOptions { sparsest_px: 0.4, ..crowded });
    assert!(dense.averages() && !dense.has_pyramid);
    assert!(!dense.without_averages().has_pyramid);
    for plan in [FramePlan::of(&ALL, &OPTIONS), plan.without_averages()] {
        assert!(!plan.averages() && plan.has_pyramid && plan.averages_read() == [false; 2]);
    }
    for method in [Method::Points, Method::Ewa] {
        assert!(!FramePlan::of(&ALL, &FrameOptions { method, ..crowded }).averages());
    }
    // In between both are mixed.
    let half = FramePlan::of(&ALL, &FrameOptions { crowding: 0.25, ..OPTIONS });
    assert!(half.averages() && half.smooths);
    assert_eq!([half.crowding(), half.smoothing()], [0.25, 0.75]);
}

#[test]
fn pixels_are_smoothed_where_points_do_not_crowd_and_colours_are_not_names() {
    let plan = |options| FramePlan::of(&ALL, &options);
    let smooth = plan(OPTIONS);
    assert!(smooth.smooths && !smooth.averages());
    let constants = smooth.variants().into_iter().flat_map(|v| v.constants);
    assert!(constants.into_iter().any(|constant| constant == ("SMOOTHS", 1)));
    let classes = FrameOptions { colour: ColourBy::Codes(Codebook::Classes), ..OPTIONS };
    let crowded = FrameOptions { crowding: 1.0, ..OPTIONS };
    assert!(!plan(classes).smooths && !plan(crowded).smooths);
    assert!(!plan(FrameOptions { smooths: false, ..OPTIONS }).smooths);
    let dense = FrameOptions { sparsest_px: 0.4, ..OPTIONS };
    let [points, ewa] =
        [Method::Points, Method::Ewa].map(|method| FrameOptions { method, ..OPTIONS });
    assert!([dense, points, ewa].into_iter().all(|options| !plan(options).smooths));
}

#[test]
fn planes_are_fitted_where_there_are_no_normals_and_depths_are_compared() {
    let bare = SceneHas { normals: false, ..ALL };
    let plan = |has, options| FramePlan::of(&has, &options);
    let shaders = |plan: &FramePlan| {
        let variants = plan.variants().into_iter();
        variants.filter(|v| v.shader.starts_with("fit_planes/")).count()
    };
    let fitted = plan(bare, OPTIONS);
    assert!(fitted.planes() == Planes::Fitted && shaders(&fitted) == 3);
    assert_eq!(fitted.passes[..3], [Pass::Project, Pass::FitPlanes, Pass::Gather]);
    assert_eq!(plan(ALL, OPTIONS).planes(), Planes::Normals);
    let [dense, crowded] =
        [FrameOptions { sparsest_px: 0.4, ..OPTIONS }, FrameOptions { crowding: 1.0, ..OPTIONS }];
    assert_eq!(plan(bare, crowded).planes(), Planes::Fitted);
    // Splats are tilted as planes of squares of all widths; their pixels have none.
    let splats = plan(bare, FrameOptions { method: Method::Ewa, ..OPTIONS });
    assert!(splats.planes() == Planes::None && shaders(&splats) == 3);
    assert_eq!(splats.passes[..3], [Pass::Project, Pass::FitPlanes, Pass::Place]);
    assert!(splats.plane_levels() > 1 && fitted.plane_levels() == 1);
    // Towards dense views planes fade.
    let fitting = |sparsest_px| plan(bare, FrameOptions { sparsest_px, ..OPTIONS }).fitting();
    let [none, half, all, far] = [0.4, 0.5, 0.6, 9.0].map(fitting);
    assert!([none, all, far] == [0.0, 1.0, 1.0] && (half - 0.5).abs() < 1e-6, "{half}");
    let points = FrameOptions { method: Method::Points, ..OPTIONS };
    for options in [dense, points, FrameOptions { fits_planes: false, ..OPTIONS }] {
        let plan = plan(bare, options);
        assert!(plan.planes() == Planes::None && shaders(&plan) == 0, "{plan:?}");
    }
    assert_eq!(shaders(&plan(ALL, OPTIONS)), 0);
}

#[test]
fn exposures_are_evened_on_request_and_only_for_colours_of_the_scans() {
    let options = FrameOptions { evens_exposure: true, ..OPTIONS };
    let plan = FramePlan::of(&ALL, &options);
    let shaders = |plan: &FramePlan| {
        let variants = plan.variants().into_iter().map(|v| v.shader);
        variants.filter(|s| s.starts_with("exposure/")).count()
    };
    assert!(plan.evens_exposure() && shaders(&plan) == 3);
    let crowded = FramePlan::of(&ALL, &FrameOptions { crowding: 1.0, ..options });
    assert!(crowded.averages() && crowded.evens_exposure());
    assert_eq!(crowded.without_averages(), FramePlan { smooths: false, ..plan });
    assert_eq!(
        crowded.without_exposure(),
        FramePlan::of(&ALL, &FrameOptions { crowding: 1.0, ..OPTIONS })
    );
    let others = [
        FramePlan::of(&ALL, &OPTIONS),
        FramePlan::of(&ALL, &FrameOptions { colour: ColourBy::Plain, ..options }),
        FramePlan::of(&SceneHas { colour_plane: false, ..ALL }, &options),
        FramePlan::of(&ALL, &FrameOptions { method: Method::Points, ..options }),
        FramePlan::of(&ALL, &FrameOptions { method: Method::Ewa, ..options }),
        plan.without_exposure(),
    ];
    for plan in others {
        assert!(!plan.evens_exposure() && shaders(&plan) == 0, "{plan:?}");
    }
}

#[test]
fn a_plan_names_a_pipeline_for_every_pass() {
    let plan = FramePlan::of(&SceneHas { hidden_points: true, ..ALL }, &OPTIONS);
    let variants = plan.variants();
    assert!(variants.len() > plan.passes.len());
    assert_eq!(
        variants[0].constants,
        [("CULLS_BACK_FACES", 1), ("HIDES_POINTS", 1), ("THINS_POINTS", 0)]
    );
    let shade = variants.iter().find(|v| v.shader == "shade").map(|v| v.constants.clone());
    assert_eq!(shade, Some(vec![("NORMALS", 1), ("SHINES", 1), ("EDGES", 1)]));
    let matt = FramePlan::of(&ALL, &FrameOptions { shines: false, ..OPTIONS });
    assert!(matt.variants().iter().any(|v| v.constants.contains(&("SHINES", 0))));
}

#[test]
fn silhouettes_are_trimmed_where_push_fills_pixels_or_on_request() {
    let trims = |options: FrameOptions| {
        let passes = FramePlan::of(&ALL, &options).passes;
        assert_eq!(passes.contains(&Pass::Shade), options.method != Method::Points);
        passes.contains(&Pass::Silhouette)
    };
    let dense = FrameOptions { sparsest_px: 0.4, ..OPTIONS };
    let forced = PassChoice { forced: PassSet::of(&[Pass::Silhouette]), ..OPTIONS.passes };
    assert!(trims(OPTIONS) && !trims(dense));
    assert!(trims(FrameOptions { passes: forced, ..dense }));
    for method in [Method::Points, Method::Ewa] {
        assert!(!trims(FrameOptions { method, passes: forced, ..dense }), "{method:?}");
    }
}

#[test]
fn optional_passes_are_skipped_and_others_are_not() {
    let dots = Dots { size: PointSize::Adaptive, eye_dome: 0.5 };
    let all = PassSet::of(&Pass::ALL);
    for method in [Method::Points, Method::PullPush, Method::Ewa] {
        let options = FrameOptions { method, crowding: 0.5, mixes_dots: true, dots, ..OPTIONS };
        let has = SceneHas { normals: false, ..ALL };
        let whole = FramePlan::of(&has, &options);
        for &pass in whole.passes.iter() {
            let skipped = PassSet::of(&[pass]);
            let passes = PassChoice { skipped, ..OPTIONS.passes };
            let plan = FramePlan::of(&has, &FrameOptions { passes, ..options });
            assert_eq!(plan.passes.contains(&pass), !pass.is_optional(), "{pass:?}");
        }
        let passes = PassChoice { skipped: all, ..OPTIONS.passes };
        let bare = FramePlan::of(&has, &FrameOptions { passes, ..options });
        assert!(bare.passes.iter().all(|pass| !pass.is_optional()), "{:?}", bare.passes);
        let flags = [bare.mixes_dots(), bare.averages(), bare.smooths, bare.has_pyramid];
        assert!(flags.into_iter().all(|flag| !flag) && bare.crowding() == 0.0);
    }
}
