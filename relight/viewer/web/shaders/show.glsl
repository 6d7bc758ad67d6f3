// Linear light as a display shows it: relight.media.colour.encode, its white the brightest there is; over a
// background, which keeps its code values: encode_over.

uniform sampler2D picture;
uniform sampler2D brightest;  // and the sum of the picture's colours
uniform vec3 before;  // that sum of the photograph
uniform float backgroundLight;  // share of the new light that reaches the background
uniform float gain;
uniform int data;    // 1: values are shown as they are
uniform float rows;  // of the page's canvas, whose bottom row is first; 0 where the top row is, alpha straight

vec3 rollOff(vec3 light, float white) {
  if (white == 1.0) return light;
  vec3 above = max(light - KNEE, 0.0) / (1.0 - KNEE);
  float top = (white - KNEE) / (1.0 - KNEE);
  return min(light, KNEE) + (1.0 - KNEE) * above * (1.0 + above / (top * top)) / (1.0 + above);
}

vec3 sRGB(vec3 light) {
  vec3 curve = 1.055 * pow(max(light, 1e-9), vec3(1.0 / 2.4)) - 0.055;
  return mix(curve, light * 12.92, vec3(lessThanEqual(light, vec3(0.0031308))));
}

vec3 shown(vec3 light, float white) {
  return clamp(rollOff(light * gain, white), 0.0, 1.0);
}

// As background_factor in relight/rendering.py.
vec3 litAsPerson(vec3 back) {
  vec3 after = texelFetch(brightest, ivec2(0), 0).gba;
  vec3 whole = mix(vec3(1.0), after / max(before, 1e-9), vec3(greaterThan(before, vec3(0.0))));
  return back * (1.0 + backgroundLight * (clamp(whole, 0.0, MAX_BACKGROUND_FACTOR) - 1.0));
}

void main() {
  ivec2 pixel = ivec2(gl_FragCoord.xy);
  if (rows > 0.0) pixel.y = int(rows) - 1 - pixel.y;
  vec4 value = texelFetch(picture, pixel, 0);
  vec3 straight = value.a > 0.0 ? value.rgb / value.a : vec3(0.0);
  if (data == 0) {
    float white = max(1.0, texelFetch(brightest, ivec2(0), 0).r * gain);
    straight = shown(straight, white);
    if (behind != 0) {
      vec3 back = shown(clamp(litAsPerson(backdrop(vec2(pixel) + 0.5)), 0.0, 1.0), max(1.0, gain));
      straight = mix(back, straight, value.a);
      value.a = 1.0;
    }
    straight = sRGB(straight);
  }
  result = rows > 0.0 ? vec4(straight * value.a, value.a) : vec4(straight, value.a);
}
