//! Adapts the picture while the camera moves, so that frames take the time that is wanted: its
//! size, and where the smallest is still too slow, the method: points alone. Times of frames are
//! predicted by the model of the machine ([`Pace`]), corrected by the frames that were drawn; until
//! it is known, they are proportional to the pixels. At rest the picture has all pixels and its own
//! method.

use esker_engine::Method;
use esker_engine::draw::pace::{Cost, Load, Pace};

/// Least scale of the picture's sides.
const SCALE_MIN: f64 = 0.33;
/// Scales are multiples of this.
const SCALE_STEP: f64 = 0.05;
/// Time that a frame is meant to take, over the time that it may take.
const AIM: f64 = 0.8;
/// Time over which frames must become faster, of the time they may take, before they are drawn
/// finer: a scale that holds does not flicker.
const FAST: f64 = 0.5;
/// Weight of the newest frame in the mean.
const NEWEST: f64 = 0.3;
/// Ratio of a frame to the mean from which on it counts alone: the view has changed.
const OTHER: f64 = 2.0;
/// Seconds after the last movement until the picture has all pixels again, while the pointer still
/// drags; at once where nothing does.
const REST_S: f64 = 0.2;

/// Time of points alone over that of surfaces, both of the smallest picture, up to which points are
/// drawn in their place.
const MUCH_FASTER: f64 = 0.8;
/// Cost of frames while the model of the machine is unknown.
const BY_PIXELS: Cost = Cost { frame_ms: 0.0, points_ms: 0.0, pixels_ms: 1.0, covered_ms: 0.0 };

/// A frame that was drawn.
#[derive(Clone, Copy, Debug)]
pub struct Drawn {
    /// Method.
    pub method: Method,
    /// Scale of the picture's sides.
    pub scale: f64,
    /// What the frame has.
    pub load: Load,
    /// Time that it took, milliseconds.
    pub ms: f64,
}

/// What is known of frames by a method.
#[derive(Clone, Copy, Debug)]
struct Known {
    method: Method,
    cost: Cost,
    /// What a frame with all pixels has.
    whole: Load,
    /// Mean time of frames over their cost.
    factor: f64,
}

impl Known {
    /// Time of a frame whose picture's sides are scaled, milliseconds. Fewer pixels show fewer
    /// points.
    fn ms(&self, scale: f64) -> f64 {
        self.factor * self.cost.cpu_ms(scaled(self.whole, scale * scale))
    }

    /// Scale of the picture's sides at which a frame takes this time.
    fn scale(&self, ms: f64) -> f64 {
        let fixed_ms = self.factor * self.cost.frame_ms;
        ((ms - fixed_ms) / (self.ms(1.0) - fixed_ms).max(1e-6)).max(0.0).sqrt()
    }
}

fn scaled(Load { points, pixels, covered }: Load, share: f64) -> Load {
    Load { points: points * share, pixels: pixels * share, covered: covered * share }
}

/// Size and method of moving pictures, from the times of frames.
#[derive(Clone, Debug)]
pub struct Sharpness {
    /// Whether pictures may be coarser while the camera moves.
    pub is_on: bool,
    /// Time that a frame may take while the camera moves, milliseconds.
    frame_ms: f64,
    scale: f64,
    /// Whether points alone are drawn in place of the chosen method.
    has_points_alone: bool,
    /// The model of the machine, once it is known.
    pace: Option<Pace>,
    /// Frames by the chosen method, and those of points alone in their place.
    own: Option<Known>,
    points: Option<Known>,
    moved_s: f64,
    /// Whether the pointer drags.
    is_held: bool,
}

impl Sharpness {
    /// Makes a scale for frames of at most `frame_ms`, that is always 1 unless `is_on`.
    pub fn new(is_on: bool, frame_ms: f64) -> Self {
        Self {
            is_on,
            frame_ms,
            scale: 1.0,
            has_points_alone: false,
            pace: None,
            own: None,
            points: None,
            moved_s: f64::NEG_INFINITY,
            is_held: false,
        }
    }

    /// Predicts the times of frames by the model of the machine from now on.
    pub fn set_pace(&mut self, pace: Pace) {
        self.pace = Some(pace);
    }

    /// Method of the picture at this time, where the user has chosen `wanted`.
    pub fn method(&self, now_s: f64, wanted: Method) -> Method {
        let is_replaced = self.has_points_alone && self.is_on && self.is_moving(now_s);
        // Light takes another session.
        if is_replaced && wanted != Method::Lit { Method::Points } else { wanted }
    }

    /// Scale of the picture's sides at this time.
    pub fn scale(&self, now_s: f64) -> f64 {
        if self.is_on && self.is_moving(now_s) { self.scale } else { 1.0 }
    }

    /// Records that the camera has moved, and whether the pointer drags it.
    pub fn moved(&mut self, now_s: f64, is_held: bool) {
        (self.moved_s, self.is_held) = (now_s, is_held);
    }

    /// Records that nothing moves any more: the next picture has all pixels.
    pub fn rests(&mut self) {
        if !self.is_held {
            self.moved_s = f64::NEG_INFINITY;
        }
    }

    /// Records that the pointer has let go.
    pub fn let_go(&mut self) {
        self.is_held = false;
    }

    /// Whether the camera moves, or has only just stopped.
    pub fn is_moving(&self, now_s: f64) -> bool {
        now_s - self.moved_s < REST_S
    }

    /// Records a frame, where the user has chosen the method `wanted`, and adapts size and method.
    /// Frames at rest tell them before the first movement.
    pub fn drew(&mut self, drawn: Drawn, wanted: Method) {
        let Drawn { method, scale, load, ms } = drawn;
        let cost = self.pace.as_ref().and_then(|pace| pace.cost(method)).copied();
        let cost = cost.unwrap_or(BY_PIXELS);
        let own = ms / cost.cpu_ms(load).max(1e-9);
        let known = if method == wanted { &mut self.own } else { &mut self.points };
        let alike = known.filter(|known| known.method == method && known.cost == cost);
        let factor = match alike.map(|known| known.factor) {
            Some(mean) if own < mean * OTHER && own > mean / OTHER => mean + (own - mean) * NEWEST,
            _ => own,
        };
        let whole = scaled(load, 1.0 / (scale * scale));
        let known = *known.insert(Known { method, cost, whole, factor });
        let now_ms = known.ms(self.scale);
        let is_other = (method != wanted) != self.has_points_alone;
        let is_finer = now_ms < self.frame_ms * FAST && self.scale < 1.0;
        if now_ms > self.frame_ms || is_finer || is_other {
            self.adapt(known, wanted);
        }
    }

    /// Chooses size and method from frames of the drawn method.
    fn adapt(&mut self, drawn: Known, wanted: Method) {
        let stepped = |known: &Known| {
            let wanted = known.scale(self.frame_ms * AIM);
            ((wanted / SCALE_STEP).floor() * SCALE_STEP).clamp(SCALE_MIN, 1.0)
        };
        if drawn.method != wanted {
            self.scale = stepped(&drawn);
            return;
        }
        let points = self.points_alone(&drawn);
        let faster = points.filter(|points| {
            let [own_ms, points_ms] = [&drawn, points].map(|known| known.ms(SCALE_MIN));
            self.frame_ms < own_ms && points_ms < own_ms * MUCH_FASTER
        });
        self.has_points_alone = faster.is_some();
        self.scale = stepped(&faster.unwrap_or(drawn));
    }

    /// What is expected of points alone: as drawn before, or by the model, as far off as it is for
    /// the chosen method. `None` where that draws points alone, and without a model.
    fn points_alone(&self, own: &Known) -> Option<Known> {
        let cost = *self.pace.as_ref()?.cost(Method::Points)?;
        let known = self.points.filter(|points| points.cost == cost);
        let factor = known.map_or(own.factor, |points| points.factor);
        let method = Method::Points;
        (own.method != method).then_some(Known { method, cost, whole: own.whole, factor })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PIXELS: f64 = 1e6;

    /// A frame of a picture of so many pixels at full size, all covered, a point each.
    fn drawn(method: Method, ms: f64, scale: f64) -> Drawn {
        let load = Load { points: PIXELS, pixels: PIXELS, covered: PIXELS };
        Drawn { method, scale, load: scaled(load, scale * scale), ms }
    }

    /// Moves for some frames of `whole_ms` with all pixels; returns their scales.
    fn moving(sharpness: &mut Sharpness, whole_ms: f64, frames: usize) -> Vec<f64> {
        let frame = |i: usize| {
            let now = i as f64 * 0.05;
            sharpness.moved(now, false);
            let scale = sharpness.scale(now);
            sharpness.drew(drawn(Method::Auto, whole_ms * scale * scale, scale), Method::Auto);
            scale
        };
        (0..frames).map(frame).collect()
    }

    fn pace(auto: Cost, points: Cost) -> Pace {
        let costs = vec![("auto".to_owned(), auto), ("points".to_owned(), points)];
        Pace { threads: 2, parallel: 1.9, waited: 0.0, costs }
    }

    const AUTO: Cost = Cost { frame_ms: 1.0, points_ms: 10.0, pixels_ms: 20.0, covered_ms: 60.0 };
    const POINTS: Cost = Cost { frame_ms: 0.2, points_ms: 4.0, pixels_ms: 2.0, covered_ms: 4.0 };

    #[test]
    fn slow_frames_become_coarser_while_moving_but_not_at_rest() {
        let mut sharpness = Sharpness::new(true, 33.0);
        let scales = moving(&mut sharpness, 120.0, 60);
        let last = scales[59];
        assert!((33.0 * FAST..=33.0).contains(&(120.0 * last * last)), "{last}");
        assert!(scales[5..].iter().all(|scale| *scale == last), "the scale has settled");
        assert_eq!(sharpness.scale(60.0), 1.0);
        assert!(moving(&mut sharpness, 10.0, 60)[59] == 1.0, "fast frames are sharp again");
        sharpness.is_on = false;
        assert_eq!(sharpness.scale(0.0), 1.0);
    }

    #[test]
    fn the_first_moving_frame_is_as_coarse_as_frames_at_rest_tell() {
        let mut sharpness = Sharpness::new(true, 33.0);
        sharpness.drew(drawn(Method::Auto, 130.0, 1.0), Method::Auto);
        sharpness.moved(1.0, false);
        let first = sharpness.scale(1.0);
        assert!((33.0 * FAST..=33.0).contains(&(130.0 * first * first)), "{first}");
        assert_eq!(sharpness.method(1.0, Method::Auto), Method::Auto);
    }

    /// What does not shrink with the picture is in the model: twice the machine's time.
    #[test]
    fn the_size_of_the_first_moving_frame_follows_the_model() {
        let slow = Cost { frame_ms: 10.0, ..AUTO };
        let mut sharpness = Sharpness::new(true, 33.0);
        sharpness.set_pace(pace(slow, slow));
        sharpness.drew(drawn(Method::Auto, 200.0, 1.0), Method::Auto);
        sharpness.moved(1.0, false);
        let first = sharpness.scale(1.0);
        let expected_ms = 20.0 + 180.0 * first * first;
        let finer_ms = 20.0 + 180.0 * (first + SCALE_STEP).powi(2);
        assert!(expected_ms <= 33.0 || first == SCALE_MIN, "{first}");
        assert!(finer_ms > 33.0 * AIM, "{first}");
    }

    #[test]
    fn points_alone_move_where_the_smallest_picture_of_surfaces_is_too_slow() {
        let mut sharpness = Sharpness::new(true, 33.0);
        // Surfaces of a great window take 90 ms at the least size, points by the model 5.
        let slow = drawn(Method::Auto, 819.0, 1.0);
        sharpness.drew(slow, Method::Auto);
        sharpness.moved(1.0, false);
        assert_eq!(sharpness.method(1.0, Method::Auto), Method::Auto, "the model is not known");
        sharpness.set_pace(pace(AUTO, POINTS));
        sharpness.drew(slow, Method::Auto);
        assert_eq!(sharpness.method(1.0, Method::Auto), Method::Points);
        assert_eq!(sharpness.method(1.0, Method::Lit), Method::Lit);
        assert_eq!(sharpness.method(60.0, Method::Auto), Method::Auto, "at rest");
        // Points take twice as long as the model says: their own frames tell it.
        let frame = |sharpness: &mut Sharpness| {
            let scale = sharpness.scale(1.0);
            let load = drawn(Method::Points, 0.0, scale).load;
            let ms = 2.0 * 9.0 * POINTS.cpu_ms(load);
            sharpness.drew(Drawn { ms, ..drawn(Method::Points, 0.0, scale) }, Method::Auto);
            ms
        };
        (0..20).for_each(|_| _ = frame(&mut sharpness));
        let ms = frame(&mut sharpness);
        assert!((33.0 * FAST * 0.8..=33.0).contains(&ms), "{ms}");
        // A view of few points: surfaces again, once one was drawn.
        sharpness.drew(drawn(Method::Auto, 20.0, 1.0), Method::Auto);
        assert_eq!(sharpness.method(1.0, Method::Auto), Method::Auto);
    }

    #[test]
    fn surfaces_move_where_points_alone_are_hardly_faster() {
        let mut sharpness = Sharpness::new(true, 33.0);
        sharpness.set_pace(pace(AUTO, Cost { covered_ms: 50.0, ..AUTO }));
        sharpness.drew(drawn(Method::Auto, 819.0, 1.0), Method::Auto);
        sharpness.moved(1.0, false);
        assert_eq!(sharpness.method(1.0, Method::Auto), Method::Auto);
        assert_eq!(sharpness.scale(1.0), SCALE_MIN);
    }

    #[test]
    fn pictures_are_sharp_at_once_where_nothing_moves_and_soon_where_a_drag_pauses() {
        let mut sharpness = Sharpness::new(true, 33.0);
        sharpness.drew(drawn(Method::Auto, 130.0, 1.0), Method::Auto);
        sharpness.moved(1.0, false);
        sharpness.rests();
        assert_eq!(sharpness.scale(1.01), 1.0);
        sharpness.moved(2.0, true);
        sharpness.rests();
        assert!(sharpness.scale(2.01) < 1.0, "the pointer may go on");
        assert_eq!(sharpness.scale(2.0 + REST_S), 1.0);
        sharpness.moved(3.0, true);
        sharpness.let_go();
        sharpness.rests();
        assert_eq!(sharpness.scale(3.01), 1.0);
    }
}
