//! Claims about plans: what is in them where it is asked, and in none else.

use super::*;
use crate::inputs::colour::{Codebook, Palette};

const ALL: SceneHas = SceneHas {
    normals: true,
    oriented_normals: true,
    colour_plane: true,
    hidden_points: false,
    clip_lines: false,
    tangents: false,
};
const ASKED: Asked = Asked {
    method: Method::PullPush,
    colour: ColourBy::Rgb,
    shines: true,
    is_dense: false,
    smooths: true,
    fits_planes: true,
    is_crowded: false,
    evens_exposure: false,
};

#[test]
fn without_normals_none_is_read_carried_or_tested() {
    let plan = FramePlan::of(&SceneHas { normals: false, ..ALL }, &ASKED);
    assert!(!plan.reads_normals && !plan.carries_normals && !plan.culls_back_faces);
    let constants = plan.variants().into_iter().flat_map(|v| v.constants);
    let flags = ["NORMALS", "CULLS_BACK_FACES"];
    assert!(constants.into_iter().all(|(name, value)| !flags.contains(&name) || value == 0));
}

#[test]
fn points_alone_read_what_their_colour_comes_from_and_nothing_else() {
    let points = Asked { method: Method::Points, ..ASKED };
    let has = SceneHas { oriented_normals: false, ..ALL };
    let reads = |colour| {
        let plan = FramePlan::of(&has, &Asked { colour, ..points });
        assert!(!plan.carries_normals && !plan.has_pyramid && !plan.shines);
        (plan.reads_colours, plan.reads_normals, plan.fetches)
    };
    assert_eq!(reads(ColourBy::Rgb), (true, false, [false, true, false]));
    assert_eq!(reads(ColourBy::Plain), (false, false, [false; 3]));
    assert_eq!(reads(ColourBy::Normal), (false, true, [false, false, true]));
    let codes = ColourBy::Codes(Codebook::Along(Palette::Viridis));
    assert_eq!(reads(codes), (true, false, [false, true, false]));
    assert_eq!(*FramePlan::of(&has, &points).passes, [Pass::Project, Pass::Resolve]);
}

#[test]
fn only_splats_of_a_scene_with_clip_lines_and_normals_are_clipped() {
    let ewa = Asked { method: Method::Ewa, ..ASKED };
    let has = SceneHas { clip_lines: true, ..ALL };
    let clips = |has: &SceneHas, asked: &Asked| {
        let plan = FramePlan::of(has, asked);
        let variants = plan.variants().into_iter().flat_map(|v| v.constants);
        assert_eq!(plan.clips, variants.into_iter().any(|c| c == ("CLIPS", 1)));
        plan.clips
    };
    assert!(clips(&has, &ewa));
    assert!(!clips(&ALL, &ewa) && !clips(&has, &ASKED));
    assert!(!clips(&SceneHas { normals: false, ..has }, &ewa));
}

#[test]
fn only_splats_of_a_scene_with_tangents_and_normals_have_shapes() {
    let ewa = Asked { method: Method::Ewa, ..ASKED };
    let has = SceneHas { tangents: true, ..ALL };
    let shapes = |has: &SceneHas, asked: &Asked| {
        let plan = FramePlan::of(has, asked);
        let variants = plan.variants().into_iter().flat_map(|v| v.constants);
        assert_eq!(plan.tangents, variants.into_iter().any(|c| c == ("TANGENTS", 1)));
        plan.tangents
    };
    assert!(shapes(&has, &ewa));
    assert!(!shapes(&ALL, &ewa) && !shapes(&has, &ASKED));
    assert!(!shapes(&SceneHas { normals: false, ..has }, &ewa));
}

#[test]
fn dense_views_are_neither_pulled_nor_pushed() {
    let plan = FramePlan::of(&ALL, &Asked { is_dense: true, ..ASKED });
    assert!(!plan.has_pyramid);
    assert!(!plan.passes.contains(&Pass::Pull) && !plan.passes.contains(&Pass::Push));
    assert!(FramePlan::of(&ALL, &ASKED).has_pyramid);
}

#[test]
fn points_are_averaged_where_they_crowd_and_nowhere_else() {
    let crowded = Asked { is_crowded: true, ..ASKED };
    let plan = FramePlan::of(&ALL, &crowded);
    assert!(plan.averages() && plan.averages_read() == [true; 2]);
    assert!(plan.variants().iter().any(|v| v.shader == "average/add"));
    let dense = FramePlan::of(&ALL, &Asked { is_dense: true, ..crowded });
    assert!(dense.averages() && !dense.has_pyramid);
    assert!(!dense.without_averages().has_pyramid);
    for plan in [FramePlan::of(&ALL, &ASKED), plan.without_averages()] {
        assert!(!plan.averages() && plan.has_pyramid && plan.averages_read() == [false; 2]);
    }
    for method in [Method::Points, Method::Ewa] {
        assert!(!FramePlan::of(&ALL, &Asked { method, ..crowded }).averages());
    }
}

#[test]
fn pixels_are_smoothed_where_points_do_not_crowd_and_colours_are_no_names() {
    let plan = |asked| FramePlan::of(&ALL, &asked);
    let smooth = plan(ASKED);
    assert!(smooth.smooths && !smooth.averages());
    let constants = smooth.variants().into_iter().flat_map(|v| v.constants);
    assert!(constants.into_iter().any(|constant| constant == ("SMOOTHS", 1)));
    let classes = Asked { colour: ColourBy::Codes(Codebook::Classes), ..ASKED };
    let crowded = Asked { is_crowded: true, ..ASKED };
    assert!(!plan(classes).smooths && !plan(crowded).smooths);
    assert!(!plan(Asked { smooths: false, ..ASKED }).smooths);
    let dense = Asked { is_dense: true, ..ASKED };
    let [points, ewa] = [Method::Points, Method::Ewa].map(|method| Asked { method, ..ASKED });
    assert!([dense, points, ewa].into_iter().all(|asked| !plan(asked).smooths));
}

#[test]
fn planes_are_told_where_there_are_no_normals_and_depths_are_compared() {
    let bare = SceneHas { normals: false, ..ALL };
    let plan = |has, asked| FramePlan::of(&has, &asked);
    let shaders = |plan: &FramePlan| {
        let variants = plan.variants().into_iter();
        variants.filter(|v| v.shader.starts_with("fit_planes/")).count()
    };
    let told = plan(bare, ASKED);
    assert!(told.planes() == Planes::Fitted && shaders(&told) == 3);
    assert_eq!(told.passes[..3], [Pass::Project, Pass::FitPlanes, Pass::Gather]);
    assert_eq!(plan(ALL, ASKED).planes(), Planes::Normals);
    let [dense, crowded] = [Asked { is_dense: true, ..ASKED }, Asked { is_crowded: true, ..ASKED }];
    // Where points crowd, their intervals stay long.
    let long = |plan: &FramePlan| {
        plan.variants().into_iter().filter(|v| v.constants.contains(&("CROWDED", 1))).count()
    };
    assert_eq!([plan(bare, ASKED), plan(bare, crowded)].map(|plan| long(&plan)), [0, 1]);
    assert_eq!(plan(bare, crowded).planes(), Planes::Fitted);
    let [points, ewa] = [Method::Points, Method::Ewa].map(|method| Asked { method, ..ASKED });
    for asked in [dense, points, ewa, Asked { fits_planes: false, ..ASKED }] {
        let plan = plan(bare, asked);
        assert!(plan.planes() == Planes::None && shaders(&plan) == 0, "{plan:?}");
    }
    assert_eq!(shaders(&plan(ALL, ASKED)), 0);
}

#[test]
fn exposures_are_evened_where_that_is_asked_and_colours_are_the_scans_own() {
    let asked = Asked { evens_exposure: true, ..ASKED };
    let plan = FramePlan::of(&ALL, &asked);
    let shaders = |plan: &FramePlan| {
        let variants = plan.variants().into_iter().map(|v| v.shader);
        variants.filter(|s| s.starts_with("exposure/")).count()
    };
    assert!(plan.evens_exposure() && shaders(&plan) == 3);
    let crowded = FramePlan::of(&ALL, &Asked { is_crowded: true, ..asked });
    assert!(crowded.averages() && crowded.evens_exposure());
    assert_eq!(crowded.without_averages(), FramePlan { smooths: false, ..plan });
    assert_eq!(
        crowded.without_exposure(),
        FramePlan::of(&ALL, &Asked { is_crowded: true, ..ASKED })
    );
    let others = [
        FramePlan::of(&ALL, &ASKED),
        FramePlan::of(&ALL, &Asked { colour: ColourBy::Plain, ..asked }),
        FramePlan::of(&SceneHas { colour_plane: false, ..ALL }, &asked),
        FramePlan::of(&ALL, &Asked { method: Method::Points, ..asked }),
        FramePlan::of(&ALL, &Asked { method: Method::Ewa, ..asked }),
        plan.without_exposure(),
    ];
    for plan in others {
        assert!(!plan.evens_exposure() && shaders(&plan) == 0, "{plan:?}");
    }
}

#[test]
fn a_plan_names_a_pipeline_for_every_pass() {
    let plan = FramePlan::of(&SceneHas { hidden_points: true, ..ALL }, &ASKED);
    let variants = plan.variants();
    assert!(variants.len() > plan.passes.len());
    assert_eq!(variants[0].constants, [("CULLS_BACK_FACES", 1), ("HIDES_POINTS", 1)]);
    let shade = variants.iter().find(|v| v.shader == "shade").map(|v| v.constants.clone());
    assert_eq!(shade, Some(vec![("NORMALS", 1), ("SHINES", 1)]));
    let matt = FramePlan::of(&ALL, &Asked { shines: false, ..ASKED });
    assert!(matt.variants().iter().any(|v| v.constants.contains(&("SHINES", 0))));
}
