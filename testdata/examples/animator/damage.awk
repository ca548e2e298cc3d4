# What a suit does to a BVH file: every joint trembles, sensors drop out (nan), and two joints are thrown for some frames.
# Gives the same numbers with every awk.
BEGIN { seed = 7 }
/^[ \t]*(ROOT|JOINT)/ { name = $2 }
/CHANNELS/ { for (i = 3; i <= NF; i++) { joint[++channels] = name; turns[channels] = $i ~ /rotation/ } }
!moving { print; moving = /^Frame Time/; next }
{
  for (c = 1; c <= NF; c++) {
    if (turns[c] && $c != 0) $c = sprintf("%.6f", $c + normal())
    if (joint[c] == "lhumerus" && within(150, 3)) $c = sprintf("%.6f", $c + 50)
    if (joint[c] == "rfemur" && within(250, 2)) $c = sprintf("%.6f", $c - 40)
    if (joint[c] ~ /^(rhumerus|rradius)$/ && within(60, 50)) $c = "nan"
    if (joint[c] ~ /^(lfemur|ltibia)$/ && within(180, 30)) $c = "nan"
  }
  print
  frame++
}
function within(first, frames) { return frame >= first && frame < first + frames }
function uniform() { seed = seed * 16807 % 2147483647; return seed / 2147483647 }
# 1 degree of noise.
function normal() { return sqrt(-2 * log(uniform())) * cos(6.283185307 * uniform()) }
