# The flexion of the knees, degrees, of a table of joint centers: the angle between thigh and shank, 0 where the leg is straight.
BEGIN { FS = OFS = "," }
NR == 1 { for (i = 1; i <= NF; i++) column[$i] = i; print "time,left,right"; next }
{ print $column["time"], flexion("L"), flexion("R") }
function flexion(side,   i, hip, knee, ankle, a, b, ab, aa, bb, cosine) {
  hip = column[side "HJC.x"]; knee = column[side "KJC.x"]; ankle = column[side "AJC.x"]
  if ($hip == "" || $knee == "" || $ankle == "") return ""
  ab = aa = bb = 0
  for (i = 0; i < 3; i++) {
    a = $(knee + i) - $(hip + i)
    b = $(ankle + i) - $(knee + i)
    ab += a * b; aa += a * a; bb += b * b
  }
  cosine = ab / sqrt(aa * bb)
  return sprintf("%.2f", atan2(sqrt(cosine < 1 ? 1 - cosine * cosine : 0), cosine) * 57.29578)
}
