// Joint bilateral upsampling (Kopf et al. 2007) from the canvas to the plate: relight/analysis/upsampling.py.

uniform sampler2D source;
uniform sampler2D guide;       // the canvas's, and in alpha whether a pixel shows the subject
uniform sampler2D plateGuide;  // the plate's, and in alpha the matte
uniform vec2 centre;
uniform float scale;

vec4 bSpline(float t) {
  float s = 1.0 - t, tt = t * t;
  return vec4(s * s * s, 3.0 * t * tt - 6.0 * tt + 4.0, -3.0 * t * tt + 3.0 * tt + 3.0 * t + 1.0, t * tt) / 6.0;
}

void main() {
  vec4 here = texelFetch(plateGuide, ivec2(gl_FragCoord.xy), 0);
  result = vec4(0.0);
  if (here.a == 0.0) return;
  vec2 size = vec2(textureSize(source, 0));
  vec2 place = clamp((gl_FragCoord.xy - centre) * scale + size * 0.5 - 0.5, vec2(1.0), size - 2.001);
  ivec2 nearest = ivec2(floor(place));
  vec4 across = bSpline(fract(place.x)), down = bSpline(fract(place.y));
  float total = 0.0;
  for (int row = 0; row < 4; row++) {
    for (int column = 0; column < 4; column++) {
      ivec2 tap = nearest + ivec2(column - 1, row - 1);
      vec4 there = texelFetch(guide, tap, 0);
      vec3 difference = (there.rgb - here.rgb) * BRIGHTEST;
      float alike = max(exp(dot(difference, difference) * (-0.5 / (SIGMA * SIGMA))), LEAST);
      float weight = across[column] * down[row] * alike * (there.a > 0.5 ? 1.0 : UNKNOWN);
      result += weight * texelFetch(source, tap, 0);
      total += weight;
    }
  }
  result /= total;
}
