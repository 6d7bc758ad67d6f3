// What is behind the person, in linear light, with their shadow on the floor in it.

uniform sampler2D background;
uniform vec2 backgroundSize;
uniform sampler2D shadow;  // of the person on the floor: factors of the background
uniform bool shadowed;
uniform float shadowAmount;  // share of the lights that cast it
uniform vec2 size;
uniform int behind;  // 0 nothing, 1 a colour, 2 a picture
uniform vec3 backgroundColour;
uniform float blur;  // radius as a share of the picture's height

const int TAPS = 48;  // over the disc that a point becomes out of focus
const float TURN = 2.39996;  // radians from one tap to the next: the golden angle

// The picture, `place` and `radius` in its own pixels: over a disc, of which coarser levels fill the gaps.
vec3 defocused(vec2 place, float radius) {
  if (radius < 0.5) return texture(background, place / backgroundSize).rgb;
  float level = log2(max(1.0, 2.0 * radius / sqrt(float(TAPS))));
  vec3 sum = vec3(0.0);
  for (int tap = 0; tap < TAPS; tap++) {
    float away = radius * sqrt((float(tap) + 0.5) / float(TAPS)), angle = float(tap) * TURN;
    sum += textureLod(background, (place + away * vec2(cos(angle), sin(angle))) / backgroundSize, level).rgb;
  }
  return sum / float(TAPS);
}

// `place`: in pixels, from the top left. A picture is scaled to cover the frame and cropped about its centre, as
// relight.over does.
vec3 backdrop(vec2 place) {
  vec3 left = shadowed ? mix(vec3(1.0), texture(shadow, place / size).rgb, shadowAmount) : vec3(1.0);
  if (behind == 1) return left * backgroundColour;
  float cover = max(size.x / backgroundSize.x, size.y / backgroundSize.y);
  return left * defocused((place - size * 0.5) / cover + 0.5 * backgroundSize, blur * size.y / cover);
}
