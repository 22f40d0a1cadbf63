//! Order of the samples of a picture. Samples along the Z-order are stratified within a batch,
//! whose size is a power of two. The first batch is as large as the first call asks; each later one
//! doubles the number of samples.

/// Sizes of the batches of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Batches {
    first_log2: u32,
    most_log2: u32,
}

/// Place of a sample in the batches.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Place {
    pub batch: u32,
    pub log2_samples: u32,
    pub number: u32,
}

impl Batches {
    /// Batches of which the first holds at least `samples`, and none more than `2^most_log2`.
    pub(crate) fn new(samples: u32, most_log2: u32) -> Self {
        let first = samples.clamp(1, 1 << 16).next_power_of_two().trailing_zeros();
        Self { first_log2: first.min(most_log2), most_log2 }
    }

    /// Place of sample `sample` of a pixel.
    pub(crate) fn place(&self, sample: u32) -> Place {
        let (mut batch, mut start, mut log2) = (0, 0u32, self.first_log2);
        loop {
            let number = sample - start;
            if number < 1 << log2 {
                return Place { batch, log2_samples: log2, number };
            }
            if log2 == self.most_log2 {
                let skipped = number >> log2;
                let number = number & ((1 << log2) - 1);
                return Place { batch: batch + skipped, log2_samples: log2, number };
            }
            start += 1 << log2;
            // The second batch is as large as the first: only then does each double the number.
            log2 += u32::from(batch > 0);
            batch += 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn batches_double_the_number_of_samples_up_to_a_limit() {
        let batches = Batches::new(3, 3);
        let places: Vec<_> = (0..32)
            .map(|sample| batches.place(sample))
            .filter(|place| place.number == 0)
            .map(|place| (place.batch, place.log2_samples))
            .collect();
        assert_eq!(places, [(0, 2), (1, 2), (2, 3), (3, 3), (4, 3)]);
        assert_eq!(Batches::new(1, 5).place(1).batch, 1);
        assert_eq!(Batches::new(u32::MAX, 2).place(u32::MAX).number, 3);
    }
}
