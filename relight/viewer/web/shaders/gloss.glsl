// Reflection at grazing angles for light of unit intensity: `reflectance` of relight/analysis/gloss.py.
const int SHADING = 0, GLOSS = 1;

uniform int part;         // which of them is drawn
uniform float roughness;

float slope(float cosine, float squared) {
  return sqrt(cosine * cosine * (1.0 - squared) + squared);
}

float reflectance(vec3 normal, vec3 toward) {
  float alpha = roughness * roughness, squared = alpha * alpha;
  float facing = max(dot(normal, toward), 0.0), viewed = max(normal.z, 0.0);
  float middle = max(sqrt(max((1.0 + toward.z) / 2.0, 0.0)), MIN_COSINE);
  float aligned = min((facing + viewed) / (2.0 * middle), 1.0);
  float lobe = alpha / (1.0 - (1.0 - squared) * aligned * aligned);
  float masking = facing * slope(viewed, squared) + viewed * slope(facing, squared);
  return lobe * lobe * pow(max(1.0 - middle, 0.0), 5.0) * facing / (2.0 * max(masking, MIN_COSINE));
}
