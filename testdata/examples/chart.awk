# Draws a CSV table as curves, SVG: its first column is x, each other column a curve, and an empty cell a break.
#   awk -v title=TEXT -v x=TEXT -v y=TEXT -f chart.awk table.csv > chart.svg
# -v decades=1      y is logarithmic
# -v dots=1         a dot at each cell
# -v bands=1:1.5:TEXT,...  stretches of x, with a word on each
# -v colors=red,...
# Where x is no number, its cells are places side by side.
BEGIN {
  FS = ","
  split(colors == "" ? "#1f6fb4,#d1622b,#8a3ffc,#0d9080" : colors, color, ",")
  gray = "#6b7684"
  left = 62; right = 734; top = 92; bottom = 300
}
NR == 1 {
  curves = NF - 1
  for (c = 1; c <= curves; c++) name[c] = $(c + 1)
  next
}
{
  place[++rows] = $1
  if ($1 !~ /^-?[0-9.]+$/) words = 1
  for (c = 1; c <= curves; c++) {
    if ($(c + 1) == "" || decades && $(c + 1) <= 0) continue
    cell[rows, c] = $(c + 1)
    v = scale($(c + 1))
    if (!cells++) low = high = v
    if (v < low) low = v
    if (v > high) high = v
  }
}
END {
  if (low == high) high = low + 1
  # Half a place stays free beside words.
  first = words ? 0.5 : place[1]; last = words ? rows + 0.5 : place[rows]
  unit = decades ? 0 : step_for((high - low) / 4)
  if (unit) { low = unit * floor(low / unit); high = -unit * floor(-high / unit) } else { low -= 0.08; high += 0.08 }

  printf "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"752\" height=\"350\" viewBox=\"0 0 752 350\" role=\"img\""
  print " font-family=\"system-ui, 'Segoe UI', Helvetica, Arial, sans-serif\" font-size=\"12\" fill=\"#39424e\">"
  print "<title>" title "</title>\n<rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>"
  print "<text x=\"18\" y=\"26\" font-size=\"15\" font-weight=\"600\">" title "</text>"
  at = 23
  for (c = 1; c <= curves; c++) {
    print "<circle cx=\"" at "\" cy=\"45\" r=\"4\" fill=\"" color[c] "\"/>"
    text(at + 9, 49, name[c], "start")
    at += 32 + 6.8 * length(name[c])
  }
  text(18, 78, y, "start")
  bands_of = split(bands, band, ",")
  for (b = 1; b <= bands_of; b++) {
    split(band[b], part, ":")
    printf "<rect x=\"%.1f\" y=\"%d\" width=\"%.1f\" height=\"%d\" fill=\"#fdf0e8\"/>\n", across(part[1]), top, across(part[2]) - across(part[1]), bottom - top
    text((across(part[1]) + across(part[2])) / 2, top + 14, part[3], "middle")
  }
  if (unit) for (v = low; v < high + unit / 2; v += unit) line(up(v), v + 0)
  else for (power = floor(low); power <= high; power++) { line(up(power), 10 ^ power); line(up(power + log(3) / log(10)), 3 * 10 ^ power) }
  if (words) for (r = 1; r <= rows; r++) text(across(r), bottom + 18, place[r], "middle")
  else { unit = step_for((last - first) / 6); for (v = -unit * floor(-first / unit); v <= last; v += unit) text(across(v), bottom + 18, v + 0, "middle") }
  text((left + right) / 2, bottom + 38, x, "middle")

  for (c = 1; c <= curves; c++) {
    path = ""; pen = "M"
    for (r = 1; r <= rows; r++) {
      if (!((r, c) in cell)) { pen = "M"; continue }
      spot = sprintf("%.1f %.1f", across(words ? r : place[r]), up(scale(cell[r, c])))
      path = path pen spot; pen = "L"
      if (dots) { split(spot, xy, " "); print "<circle cx=\"" xy[1] "\" cy=\"" xy[2] "\" r=\"4\" fill=\"" color[c] "\"/>" }
    }
    print "<path d=\"" path "\" fill=\"none\" stroke=\"" color[c] "\" stroke-width=\"2\" stroke-linejoin=\"round\"/>"
  }
  print "</svg>"
}
function scale(v) { return decades ? log(v) / log(10) : v + 0 }
function floor(v) { return v < int(v) ? int(v) - 1 : int(v) }
# 1, 2 or 5 times a power of ten, at least v.
function step_for(v,   power) {
  power = 10 ^ floor(log(v) / log(10))
  return v <= power ? power : v <= 2 * power ? 2 * power : v <= 5 * power ? 5 * power : 10 * power
}
function across(v) { return left + (v - first) / (last - first) * (right - left) }
function up(v) { return bottom - (v - low) / (high - low) * (bottom - top) }
function text(x, y, words, anchor) { printf "<text x=\"%.1f\" y=\"%.1f\" text-anchor=\"%s\" fill=\"%s\">%s</text>\n", x, y, anchor, gray, words }
function line(y, value) {
  if (y > bottom + 0.5 || y < top - 0.5) return
  printf "<path d=\"M%d %.1fH%d\" stroke=\"#dde2e8\"/>\n", left, y, right
  text(left - 8, y + 4, value, "end")
}
