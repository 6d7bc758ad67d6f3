// What is behind the person, in linear light, with their shadow on the floor in it.

uniform sampler2D background;
uniform vec2 backgroundSize;
uniform sampler2D shadow;  // of the person on the floor: factors of the background
uniform bool shadowed;
uniform float shadowAmount;  // share of the lights that cast it
uniform vec2 size;
uniform int behind;  // 0 nothing, 1 a colour, 2 a picture
uniform vec3 backgroundColour;

// `place`: in pixels, from the top left. A picture is scaled to cover the frame and cropped about its centre, as
// relight.over does.
vec3 backdrop(vec2 place) {
  vec3 left = shadowed ? mix(vec3(1.0), texture(shadow, place / size).rgb, shadowAmount) : vec3(1.0);
  if (behind == 1) return left * backgroundColour;
  float cover = max(size.x / backgroundSize.x, size.y / backgroundSize.y);
  return left * texture(background, (place - size * 0.5) / (backgroundSize * cover) + 0.5).rgb;
}
