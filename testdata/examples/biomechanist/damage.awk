# What goes wrong in a gait laboratory, in a pose table of its markers: hidden markers, a reflection, a lost label, exchanged legs.
# Frames count from 0; the last one of a stretch is not in it.
BEGIN { FS = OFS = "," }
NR == 1 { for (i = 1; i <= NF; i++) column[$i] = i; print $0, "*39.x", "*39.y", "*39.z"; next }
{
  frame = NR - 2
  # An arm hides a hip at each of its swings. A chair hides a thigh and a knee.
  hide("LASI", 20, 40); hide("RASI", 54, 76); hide("LASI", 92, 112); hide("RASI", 122, 146)
  hide("LTHI", 116, 140); hide("LKNE", 116, 140)
  # A reflection draws a toe up.
  if (within(130, 133)) $column["LTOE.y"] += 9
  # A heel loses its label.
  piece = ",,"
  if (within(40, 70)) piece = $column["RHEE.x"] OFS $column["RHEE.y"] OFS $column["RHEE.z"]
  hide("RHEE", 40, 70)
  # Where the legs pass each other, one becomes the other.
  if (within(70, 110)) { swap("LKNE", "RKNE"); swap("LTIB", "RTIB"); swap("LANK", "RANK") }
  print $0, piece
}
function within(first, last) { return frame >= first && frame < last }
function hide(name, first, last,   i) {
  if (within(first, last)) for (i = 0; i < 3; i++) $(column[name ".x"] + i) = ""
}
function swap(a, b,   i, cell) {
  for (i = 0; i < 3; i++) {
    cell = $(column[a ".x"] + i)
    $(column[a ".x"] + i) = $(column[b ".x"] + i)
    $(column[b ".x"] + i) = cell
  }
}
