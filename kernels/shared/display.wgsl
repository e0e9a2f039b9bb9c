// From radiance to what a target holds.

// Khronos PBR Neutral tone mapping, version 1.0: keeps base colours, compresses highlights.
// https://github.com/KhronosGroup/ToneMapping/tree/main/PBR_Neutral
fn tone_map(radiance: vec3<f32>) -> vec3<f32> {
    let start = 0.8 - 0.04;
    let desaturation = 0.15;
    let low = min(radiance.x, min(radiance.y, radiance.z));
    let offset = select(0.04, low - 6.25 * low * low, low < 0.08);
    let color = radiance - offset;
    let peak = max(color.x, max(color.y, color.z));
    if peak < start {
        return color;
    }
    let room = 1.0 - start;
    let new_peak = 1.0 - room * room / (peak + room - start);
    let grey = 1.0 - 1.0 / (desaturation * (peak - new_peak) + 1.0);
    return mix(color * (new_peak / peak), vec3(new_peak), grey);
}

// IEC 61966-2-1. The curve's power is a minimax fit in roots (a form of Ian Taylor's), which are cheaper:
// at most 5e-5 off, a hundredth of an 8-bit step.
fn srgb(linear: vec3<f32>) -> vec3<f32> {
    let root = sqrt(linear);
    let root4 = sqrt(root);
    let root8 = sqrt(root4);
    let curve = 0.6423768 * root + 0.7120991 * root4 - 0.3368656 * root8 - 0.0175672 * linear;
    return select(linear * 12.92, curve, linear > vec3(0.0031308));
}

// The pixel of a target, for `parameters.exposure` and `parameters.encoding`.
fn encode(radiance: vec3<f32>) -> vec4<f32> {
    if parameters.encoding == 0u {
        return vec4(radiance, 1.0);
    }
    let mapped = clamp(tone_map(min(radiance * parameters.exposure, vec3(1e30))), vec3(0.0), vec3(1.0));
    if parameters.encoding == 1u {
        return vec4(mapped, 1.0);
    }
    return vec4(srgb(mapped), 1.0);
}
