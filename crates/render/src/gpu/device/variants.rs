//! Kernels of one shader that differ in the values of their `override`s; each is built when it is
//! first used.

use crate::gpu::device::Gpu;
use crate::gpu::device::error::GpuError;
use crate::gpu::device::kernel::Kernel;
use crate::gpu::device::shader::Source;
use std::collections::HashMap;
use std::collections::hash_map::Entry;

/// Values of the `override`s, in their order.
type Values<const N: usize> = [u32; N];

/// Kernels by the values of their `override`s.
pub struct Variants<const N: usize> {
    source: Source,
    constants: [&'static str; N],
    kernels: HashMap<Values<N>, Kernel>,
}

impl<const N: usize> Variants<N> {
    /// Variants of the entry point `main` of a shader with these `override`s; builds none yet.
    pub fn new(source: Source, constants: [&'static str; N]) -> Self {
        Self { source, constants, kernels: HashMap::new() }
    }

    /// The kernel with these values, built on first use.
    ///
    /// # Errors
    /// If the driver refuses the shader.
    pub fn get(&mut self, gpu: &Gpu, values: Values<N>) -> Result<&Kernel, GpuError> {
        match self.kernels.entry(values) {
            Entry::Occupied(known) => Ok(known.into_mut()),
            Entry::Vacant(place) => {
                let mut pairs = [("", 0.0); N];
                for ((pair, name), value) in pairs.iter_mut().zip(self.constants).zip(values) {
                    *pair = (name, f64::from(value));
                }
                Ok(place.insert(Kernel::new(gpu, self.source, "main", &pairs)?))
            }
        }
    }

    /// All kernels built so far.
    pub fn all(&mut self) -> impl Iterator<Item = &mut Kernel> {
        self.kernels.values_mut()
    }

    /// Calls [`Kernel::reload`] for all kernels built so far.
    ///
    /// # Errors
    /// If the changed shader does not build; the old kernel stays.
    pub fn reload(&mut self, gpu: &Gpu) -> Result<bool, GpuError> {
        let mut any = false;
        for kernel in self.kernels.values_mut() {
            any |= kernel.reload(gpu)?;
        }
        Ok(any)
    }
}
