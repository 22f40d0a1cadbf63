//! The worked examples of marroquim2007: the renormalised weights of figure 5 and the displacement
//! vector of figure 3, exactly.

use esker_render::passes::pull;
use esker_render::passes::push;
use esker_render::picture::pyramid::{INVALID, Planes, Pyramid};
use glam::{Vec2, Vec4};

/// The two finest levels of a pyramid over 4 x 4 pixels, all of them invalid.
fn two_levels() -> Pyramid {
    let mut pyramid = Pyramid::default();
    pyramid.fit(4, 4, Planes::None);
    pyramid.levels.truncate(2);
    pyramid.levels.iter_mut().for_each(|l| l.front.fill(INVALID));
    pyramid
}

#[test]
fn figure_5_three_of_four_pixels_weigh_one_three_and_nine_thirteenths() {
    // Pixel (1, 1) lies below coarser pixel (0, 0), whose neighbours are (1, 0), (0, 1) and (1, 1).
    let mut pyramid = two_levels();
    let coarser = &mut pyramid.levels[1];
    let colours = [Vec4::X, Vec4::Y, Vec4::splat(9.0), Vec4::Z];
    for (i, colour) in colours.into_iter().enumerate() {
        coarser.front[i] = Vec4::new(1.0, 2.0, 0.0, 0.0);
        // Three ellipses include the centre of the pixel; the ellipse of (0, 1) does not.
        let radius = if i == 2 { 1.0 } else { 10.0 };
        coarser.tint[i] = colour.truncate().extend(radius);
    }
    push::push(&mut pyramid);
    let got = pyramid.levels[0].tint[4 + 1];
    assert_eq!(got, Vec4::new(9.0 / 13.0, 3.0 / 13.0, 1.0 / 13.0, 10.0));
}

#[test]
fn four_pixels_have_the_weights_of_the_subdivision_in_figure_4() {
    let mut pyramid = two_levels();
    let coarser = &mut pyramid.levels[1];
    for i in 0..4 {
        coarser.front[i] = Vec4::new(1.0, 2.0, 0.0, 0.0);
        coarser.tint[i] = Vec4::new(f32::from(i == 0), f32::from(i == 1), f32::from(i == 2), 10.0);
    }
    push::push(&mut pyramid);
    let weights =
        |pixel: usize| pyramid.levels[0].tint[pixel].truncate().to_array().map(|w| w * 16.0);
    assert_eq!(weights(4 + 1), [9.0, 3.0, 3.0]);
    assert_eq!(weights(4 + 2), [3.0, 9.0, 1.0]);
    assert_eq!(weights(8 + 1), [3.0, 1.0, 9.0]);
    // At the corner only one of the four coarser pixels exists.
    assert_eq!(weights(0), [16.0, 0.0, 0.0]);
}

#[test]
fn figure_3_the_displacement_points_from_the_sample_to_the_pixel_after_three_pulls() {
    let mut pyramid = Pyramid::default();
    pyramid.fit(8, 8, Planes::None);
    for sample in [(0, 0), (5, 2), (7, 7), (3, 4)] {
        let base = &mut pyramid.levels[0];
        base.front.fill(INVALID);
        base.front[sample.1 * 8 + sample.0] = Vec4::new(1.0, 2.0, 0.0, 0.0);
        pull::pull(&mut pyramid);
        let p0 = Vec2::new(sample.0 as f32 + 0.5, sample.1 as f32 + 0.5);
        for (i, level) in pyramid.levels.iter().enumerate() {
            let (x, y) = (sample.0 >> i, sample.1 >> i);
            let front = level.front[y * level.width + x];
            // The difference vectors add up exactly: the centre of the ellipse is still the sample.
            assert_eq!(Vec2::new(front.z, front.w), level.centre(x, y) - p0, "level {i}");
        }
        // p3 is the centre of the picture.
        let p3 = pyramid.levels[3].front[0];
        assert_eq!(Vec2::new(p3.z, p3.w), Vec2::splat(4.0) - p0);
    }
}

#[test]
fn figure_3b_two_samples_give_an_ellipse_between_them() {
    let mut pyramid = Pyramid::default();
    pyramid.fit(2, 2, Planes::None);
    let base = &mut pyramid.levels[0];
    base.front.fill(INVALID);
    for (pixel, depth, radius) in [(0, 1.0, 2.0), (1, 1.5, 4.0)] {
        base.front[pixel] = Vec4::new(depth, depth + 1.0, 0.0, 0.0);
        base.tint[pixel] = Vec4::new(0.0, 0.0, 0.0, radius);
    }
    pull::pull(&mut pyramid);
    let top = &pyramid.levels[1];
    // The centre is (1, 0.5), half a pixel above that of the coarse pixel; the interval spans both
    // depths.
    assert_eq!(top.front[0], Vec4::new(1.0, 2.5, 0.0, 0.5));
    assert_eq!(top.tint[0].w, 3.0);
}

#[test]
fn an_occluded_pixel_takes_the_front_surface_only_where_an_ellipse_covers_it() {
    for (radius, expected) in [(10.0, 1.0), (0.1, 5.0)] {
        let mut pyramid = Pyramid::default();
        pyramid.fit(2, 2, Planes::None);
        let base = &mut pyramid.levels[0];
        base.front.fill(INVALID);
        base.front[0] = Vec4::new(1.0, 1.5, 0.0, 0.0);
        base.front[3] = Vec4::new(5.0, 5.5, 0.0, 0.0);
        base.tint[0] = Vec4::new(1.0, 1.0, 1.0, radius);
        base.tint[3] = Vec4::new(0.0, 0.0, 0.0, radius);
        pull::pull(&mut pyramid);
        assert_eq!(pyramid.levels[1].front[0].y, 1.5, "the occluded pixel does not enter the mean");
        push::push(&mut pyramid);
        assert_eq!(pyramid.levels[0].front[3].x, expected, "radius {radius}");
    }
}
