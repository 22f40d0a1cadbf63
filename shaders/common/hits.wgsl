// `y` of the hits of a frame buffer, bits of the depth, where no point won.
const NO_HIT: u32 = 0xffffffffu;
