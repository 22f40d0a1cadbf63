//! Kernels of one shader that differ in their constants, each made when it is first used.

use crate::gpu::device::Gpu;
use crate::gpu::device::error::GpuError;
use crate::gpu::device::kernel::Kernel;
use crate::gpu::device::shader::Source;
use std::collections::HashMap;
use std::collections::hash_map::Entry;

/// The values of the constants, in their order.
type Values<const N: usize> = [u32; N];

/// Kernels by the values of their constants.
pub struct Variants<const N: usize> {
    source: Source,
    constants: [&'static str; N],
    kernels: HashMap<Values<N>, Kernel>,
}

impl<const N: usize> Variants<N> {
    /// Of a shader with these `override`s, whose entry point is `main`.
    pub fn new(source: Source, constants: [&'static str; N]) -> Self {
        Self { source, constants, kernels: HashMap::new() }
    }

    /// The kernel with these values.
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

    /// All that there are.
    pub fn all(&mut self) -> impl Iterator<Item = &mut Kernel> {
        self.kernels.values_mut()
    }

    /// [`Kernel::reload`] for all that there are.
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
