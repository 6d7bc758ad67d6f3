// A lamp in the room on the networks' canvas: its shading in RGB, and in alpha the share of it that nothing
// blocks, or its gloss. As light.glsl, but each pixel has its own direction and distance: relight/lights/near.py.
const float PI = 3.1415926536;

uniform sampler2DArray features;
uniform sampler2D surface;    // normals, and the slope of the gate
uniform sampler2D positions;  // metres
uniform sampler2DArray table; // the weights of the components by direction, then the two constants
uniform vec3 position;
uniform vec3 axis;  // that the way to the lamp turns from most
uniform float radius;
uniform float rays;
uniform float residualBias;

// Octahedral map of the sphere, whose outermost texels lie on the fold.
vec2 unfolded(vec3 toward) {
  vec3 folded = toward / (abs(toward.x) + abs(toward.y) + abs(toward.z));
  vec2 sides = vec2(folded.x < 0.0 ? -1.0 : 1.0, folded.y < 0.0 ? -1.0 : 1.0);
  vec2 place = folded.z < 0.0 ? (1.0 - abs(folded.yx)) * sides : folded.xy;
  float side = float(textureSize(table, 0).x);
  return (place * 0.5 + 0.5) * (side - 1.0) / side + 0.5 / side;
}

void main() {
  ivec2 pixel = ivec2(gl_FragCoord.xy);
  vec4 here = texelFetch(surface, pixel, 0);
  result = vec4(0.0);
  if (here.w == 0.0) return;  // farther from the person than maps are continued
  vec4 parts[CAST + RESIDUAL];
  for (int k = 0; k < CAST + RESIDUAL; k++) parts[k] = texelFetch(features, ivec3(pixel, k), 0);
  vec3 way = position - texelFetch(positions, pixel, 0).xyz;
  float squared = max(dot(way, way), MIN_SQUARED);
  vec3 straight = way * inversesqrt(squared);
  vec3 aside = normalize(cross(straight, axis));
  vec3 other = cross(straight, aside);
  float depth = 1.0 - sqrt(max(0.0, 1.0 - radius * radius / squared));  // of the cap that the sphere covers
  float facings = 0.0, open = texelFetch(rim, pixel, 0).r;
  for (float ray = 0.0; ray < rays; ray++) {
    float along = 1.0 - depth * (ray + 0.5) / rays;
    float angle = 2.0 * PI * GOLDEN * ray;
    vec3 around = aside * cos(angle) + other * sin(angle);
    vec3 toward = straight * along + around * sqrt(max(0.0, 1.0 - along * along));
    vec2 place = unfolded(toward);
    vec2 constants = texture(table, vec3(place, CAST + RESIDUAL)).xy;
    float logit = constants.x, residual = constants.y;
    for (int k = 0; k < CAST; k++) logit += dot(texture(table, vec3(place, k)), parts[k]);
    for (int k = CAST; k < CAST + RESIDUAL; k++) residual += dot(texture(table, vec3(place, k)), parts[k]);
    float facing = dot(here.xyz, toward);
    float unblocked = 1.0 / (1.0 + exp(-logit));
    float visibility = unblocked / (1.0 + exp(-here.w * facing));
    residual -= clamp(residual, 0.0, residualBias);
    float shading = clamp(max(facing, 0.0) * visibility + residual, 0.0, 1.0);
    result += vec4(vec3(part == GLOSS ? reflectance(here.xyz, toward) * unblocked * open : shading), visibility);
    facings += along;
  }
  result = min(vec4(result.rgb / (squared * facings), result.a / rays), MOST);
}
