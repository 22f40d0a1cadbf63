//! Checks at compile time that a structure has the same layout in Rust and WGSL, and that a
//! constant has the same value in both. Part of every crate that has shaders: `gpu::sources` of the
//! crate is what its build script generated.

/// Fails the build if a `repr(C)` structure has another layout than the shaders' structure of the
/// same name: `same_layout!(Draw { base, shift });`
macro_rules! same_layout {
    ($name:ident { $($member:ident),* $(,)? }) => {
        const _: () = {
            use $crate::gpu::sources::layout::$name as shader;
            assert!(size_of::<$name>() == shader::SIZE, "size");
            $(assert!(std::mem::offset_of!($name, $member) == shader::$member, stringify!($member));)*
        };
    };
}

/// Fails the build if a constant of a shader differs from one of a Rust module:
/// `same_values!(fit_planes_fit == crate::passes::fit_planes { AREA_MIN, TRUST[..] = [A, B] });`
///
/// Vectors and arrays have `[..]`. Expressions may use the constants of the module by their names;
/// without an expression, the constant in Rust has the name of that in the shader.
macro_rules! same_values {
    ($shader:ident == $($twin:ident)::+ {
        $($name:ident $([$($all:tt)+])? $(= $value:expr)?),* $(,)?
    }) => {
        const _: () = {
            #[allow(unused_imports, reason = "expressions may name other modules")]
            use $($twin)::+::*;
            $($crate::gpu::same_values!(@pair $shader $name [$($($all)+)?] $name $(= $value)?);)*
        };
    };
    (@pair $shader:ident $name:ident [$($all:tt)*] $twin:ident) => {
        $crate::gpu::same_values!(@pair $shader $name [$($all)*] $twin = $twin);
    };
    (@pair $shader:ident $name:ident [] $twin:ident = $value:expr) => {
        let shader = $crate::gpu::sources::constants::$shader::$name;
        assert!(shader as f64 == $value as f64, stringify!($name));
    };
    (@pair $shader:ident $name:ident [..] $twin:ident = $value:expr) => {
        let shader = $crate::gpu::sources::constants::$shader::$name;
        let twin = $value;
        assert!(shader.len() == twin.len(), stringify!($name));
        let mut i = 0;
        while i < twin.len() {
            assert!(shader[i] as f64 == twin[i] as f64, stringify!($name));
            i += 1;
        }
    };
}

/// Names constants of a shader that no Rust code has: `without_twin!(ewa_blend { BLOCKS });`
macro_rules! without_twin {
    ($shader:ident { $($name:ident),* $(,)? }) => {
        $(const _: () = {
            let _ = $crate::gpu::sources::constants::$shader::$name;
        };)*
    };
}

pub(crate) use {same_layout, same_values, without_twin};
