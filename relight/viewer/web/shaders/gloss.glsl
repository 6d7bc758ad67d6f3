// Light that fibres scatter, of a light of unit intensity: `reflectance` of relight/analysis/gloss.py.
const int SHADING = 0, GLOSS = 1;

uniform int part;  // which of them is drawn
uniform sampler2D rim;  // share of the gloss that reaches a pixel: relight/analysis/backlight.py

float reflectance(vec3 normal, vec3 toward) {
  float lit = max(dot(normal, toward) - BEND * toward.z, 0.0), seen = max(normal.z - BEND, MIN_COSINE);
  float phase = (1.0 - FORWARD * FORWARD) / pow(1.0 + FORWARD * FORWARD + 2.0 * FORWARD * toward.z, 1.5);
  float share = DEPTH / (seen + DEPTH);
  return lit / (lit + share * seen) * share * pow(max(1.0 - seen, 0.0), 5.0) * phase / 4.0;
}
