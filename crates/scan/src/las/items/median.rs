//! Running median as LASzip keeps it to predict differences (`laszip_common_v2.hpp`,
//! `StreamingMedian5`).

/// Median of five values, of which each new one replaces the largest or the smallest in turn, so
/// that it follows the values.
#[derive(Clone, Copy, Debug)]
pub struct Median {
    sorted: [i32; 5],
    replaces_largest: bool,
}

impl Default for Median {
    fn default() -> Self {
        Self { sorted: [0; 5], replaces_largest: true }
    }
}

impl Median {
    /// The median now.
    pub fn get(&self) -> i32 {
        self.sorted[2]
    }

    /// Takes in a value.
    pub fn add(&mut self, value: i32) {
        let median = self.sorted[2];
        if self.replaces_largest {
            let place = self.sorted[..4].iter().filter(|&&held| held <= value).count();
            self.sorted.copy_within(place..4, place + 1);
            self.sorted[place] = value;
            self.replaces_largest = value < median;
        } else {
            let place = self.sorted[1..].iter().filter(|&&held| held < value).count();
            self.sorted.copy_within(1..=place, 0);
            self.sorted[place] = value;
            self.replaces_largest = value <= median;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::Median;

    /// The values a median of five goes through, computed by hand from the description in LASzip.
    #[test]
    fn follows_the_values() {
        let mut median = Median::default();
        let medians = [5, 7, 6, 9, -3, -4, -5, -6, 2].map(|value| {
            median.add(value);
            median.get()
        });
        // The values held: 00005, 00057, 00567, 05679, -35679, -4-3567, -5-4-356, ...
        assert_eq!(medians, [0, 0, 5, 6, 6, 5, -3, -4, -4]);
    }
}
