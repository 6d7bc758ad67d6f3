// One light on the networks' canvas: its shading in RGB, and in alpha the share of it that nothing blocks. Or its gloss.
// shading.diffuse.Shading and shadow.networks.field.Visibility, in which cast(p, L) = Σ a(L) F(p) here.

uniform sampler2DArray features;
uniform sampler2D surface;  // normals, and the slope of the gate
uniform int count;
uniform float residualBias;
uniform float share;

// A sample is 14 vec4: direction and the cast's constant, power and the residual's constant, the weights.
layout(std140) uniform Samples { vec4 rows[840]; };

void main() {
  ivec2 pixel = ivec2(gl_FragCoord.xy);
  vec4 here = texelFetch(surface, pixel, 0);
  result = vec4(0.0);
  if (here.w == 0.0) return;  // farther from the person than maps are continued
  vec4 parts[CAST + RESIDUAL];
  for (int k = 0; k < CAST + RESIDUAL; k++) parts[k] = texelFetch(features, ivec3(pixel, k), 0);
  for (int i = 0; i < count; i++) {
    vec4 toward = rows[14 * i], power = rows[14 * i + 1];
    float logit = toward.w, residual = power.w;
    for (int k = 0; k < CAST; k++) logit += dot(rows[14 * i + 2 + k], parts[k]);
    for (int k = CAST; k < CAST + RESIDUAL; k++) residual += dot(rows[14 * i + 2 + k], parts[k]);
    float facing = dot(here.xyz, toward.xyz);
    float unblocked = 1.0 / (1.0 + exp(-logit));
    if (part == GLOSS) {
      result.rgb += power.rgb * reflectance(here.xyz, toward.xyz) * unblocked * texelFetch(rim, pixel, 0).r;
      continue;
    }
    float visibility = unblocked / (1.0 + exp(-here.w * facing));
    residual -= clamp(residual, 0.0, residualBias);
    float shading = clamp(max(facing, 0.0) * visibility + residual, 0.0, 1.0);
    result += vec4(power.rgb * shading, dot(LUMINANCE, power.rgb) * share * visibility);
  }
}
