// A look of the whole picture: linear light, premultiplied, over the background; or data.
const int PICTURE = 0, LIGHT = 1, VISIBILITY = 2, NORMALS = 3, ALBEDO = 4, PHOTOGRAPH = 5;

uniform sampler2D light;  // enlarged: the light and its visibility, or the normals
uniform sampler2D reflection;  // enlarged: what a gloss of 1 adds
uniform float gloss;
uniform float amount;  // of the lights
uniform float photographed;  // the share of the photograph's own light: 1 - amount
uniform sampler2D plateGuide;
uniform sampler2D albedo;
uniform sampler2D photograph;
uniform vec4 box;  // left, top, width and height of the person's part
uniform vec3 place;  // the photograph's scale about the picture's middle, its shift right and down in pixels
uniform int look;
uniform float lightScale;
uniform float gain;

vec3 person(ivec2 pixel) {
  vec4 lit = texelFetch(light, pixel, 0);
  if (look == PICTURE) {
    vec3 added = gloss > 0.0 ? gloss * texelFetch(reflection, pixel, 0).rgb : vec3(0.0);
    vec3 relit = (texelFetch(albedo, pixel, 0).rgb * lit.rgb + added) * lightScale;
    return amount * relit + photographed * texelFetch(photograph, pixel, 0).rgb / gain;
  }
  if (look == LIGHT) return lit.rgb * lightScale;
  if (look == VISIBILITY) return lit.aaa;
  if (look == NORMALS) return normalize(lit.xyz) * 0.5 + 0.5;
  if (look == ALBEDO) return texelFetch(albedo, pixel, 0).rgb;
  return texelFetch(photograph, pixel, 0).rgb / gain;
}

// A pixel of the person's part, premultiplied; nothing beyond it.
vec4 seen(ivec2 pixel) {
  bool inside = all(greaterThanEqual(pixel, ivec2(0))) && all(lessThan(pixel, ivec2(box.zw)));
  float coverage = inside ? texelFetch(plateGuide, pixel, 0).a : 0.0;
  return coverage > 0.0 ? vec4(person(pixel) * coverage, coverage) : vec4(0.0);
}

vec4 interpolated(vec2 at) {
  ivec2 corner = ivec2(floor(at));
  vec2 part = fract(at);
  vec4 top = mix(seen(corner), seen(corner + ivec2(1, 0)), part.x);
  return mix(top, mix(seen(corner + ivec2(0, 1)), seen(corner + ivec2(1, 1)), part.x), part.y);
}

void main() {
  vec2 taken = (gl_FragCoord.xy - 0.5 * size - place.yz) / place.x + 0.5 * size;
  bool moved = place != vec3(1.0, 0.0, 0.0);
  result = moved ? interpolated(taken - box.xy - 0.5) : seen(ivec2(floor(gl_FragCoord.xy - box.xy)));
  if (behind != 0) result = vec4(result.rgb + (1.0 - result.a) * backdrop(gl_FragCoord.xy), 1.0);
  result = min(result, MOST);
}
