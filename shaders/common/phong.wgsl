// Phong lighting with lights that move with the viewer. Needs an override `SHINES`: whether there
// are highlights. Twin: crates/render/src/passes/shade.rs, which explains the constants.

// Direction to the key light in view space, of unit length.
const KEY: vec3<f32> = vec3<f32>(-0.42, 0.60, 0.6808);
// Shares of the lights.
const KEY_SHARE: f32 = 0.62;
const EYE_SHARE: f32 = 0.16;
const SKY_SHARE: f32 = 0.30;
const GROUND_SHARE: f32 = 0.12;
const SHINE: f32 = 0.10;

// Phong lighting of a colour, linear light.
fn phong(colour: vec3<f32>, normal: vec3<f32>, to_eye: vec3<f32>) -> vec3<f32> {
    let facing = dot(normal, KEY);
    let ambient = GROUND_SHARE + (SKY_SHARE - GROUND_SHARE) * (0.5 + 0.5 * normal.y);
    let diffuse = KEY_SHARE * max(facing, 0.0) + EYE_SHARE * max(dot(normal, to_eye), 0.0);
    if !SHINES {
        return colour * (ambient + diffuse);
    }
    let mirrored = normal * (2.0 * facing) - KEY;
    var shine = 0.0;
    if facing > 0.0 {
        // The 24th power.
        let s1 = max(dot(mirrored, to_eye), 0.0);
        let s2 = s1 * s1;
        let s4 = s2 * s2;
        let s8 = s4 * s4;
        shine = s8 * s8 * s8;
    }
    return colour * (ambient + diffuse) + SHINE * shine;
}
