//! Times the filters.
use esker_trace::Image;
use esker_trace::filter::*;
fn main() {
    let (w, h) = (1024, 768);
    let mut guides =
        Guides { width: w, height: h, planes: vec![], kinds: vec![], is_hit: vec![true; w * h] };
    for k in 0..5 {
        guides.planes.push(
            (0..w * h)
                .map(|i| {
                    0.5 + 0.5 * ((i % w) as f32 / (30.0 + k as f32) + (i / w) as f32 / 50.0).sin()
                })
                .collect(),
        );
        guides.kinds.push(if k < 3 { GuideKind::Normal } else { GuideKind::Depth });
    }
    let mut noisy = Image::<3>::new(w, h);
    let mut s = 1u32;
    for p in &mut noisy.planes {
        for v in p {
            s = s.wrapping_mul(1664525).wrapping_add(1013904223);
            *v = (s >> 8) as f32 / 16777216.0;
        }
    }
    for n in std::env::args().skip(1).map(|a| a.parse::<usize>().unwrap()) {
        let g = Guides {
            planes: guides.planes[..n].to_vec(),
            kinds: guides.kinds[..n].to_vec(),
            ..guides.clone()
        };
        for r in [8, 32] {
            let mut best = f64::MAX;
            for _ in 0..8 {
                let t = std::time::Instant::now();
                let out = filter(
                    &noisy,
                    &g,
                    1,
                    &Settings { radius: Some(r), ..Settings::of(FilterKind::Guided) },
                );
                best = best.min(t.elapsed().as_secs_f64());
                std::hint::black_box(out);
            }
            println!("{n} guides r {r}: {:.1} ms", best * 1e3);
        }
    }
}
