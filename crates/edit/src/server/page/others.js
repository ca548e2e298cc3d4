
// Other poses with the same pins: shown as ghosts, one at a time, and taken or left.

const others = { list: [], at: -1, asked: false };

const otherGhost = () => others.at >= 0 ? others.list[others.at].pose : null;

const nextOther = by => inOrder(async () => {
  if (others.at >= 0) { showOther((others.at + by + others.list.length) % others.list.length); return; }
  if (!ready()) return;
  others.asked = true;
  guide();
  try {
    const { solutions } = await request("/solutions", {});
    others.list = solutions;
    if (!solutions.length) say("No other pose fits these pins.");
    else if (!now.gesture) showOther(by > 0 ? 0 : solutions.length - 1);
  } catch (error) {
    if (error.status) say(error.message);
  }
  others.asked = false;
  guide();
});

function showOther(at) {
  others.at = at;
  $("choice").hidden = at < 0;
  if (at >= 0) {
    const other = others.list[at], most = Math.max(...Object.keys(other.pose).map(j => now.pose[j] ? far(other.pose[j], now.pose[j]) : 0));
    $("choice-which").textContent = `Pose ${at + 1} of ${others.list.length}`;
    $("choice-which").title = `Its joints are up to ${cm(most)} away.`;
    speak(`Other pose ${at + 1} of ${others.list.length}, up to ${cm(most)} away`);
  }
  guide();
  ask();
}

function leaveOthers() { if (others.at >= 0) showOther(-1); }

function takeOther() {
  inOrder(() => {
    const solution = others.at;
    if (solution < 0) return;
    showOther(-1);
    return act({ do: "take", solution });
  });
}

$("others").addEventListener("click", () => nextOther(1));
$("choice-next").addEventListener("click", () => nextOther(1));
$("choice-before").addEventListener("click", () => nextOther(-1));
$("choice-take").addEventListener("click", takeOther);
$("choice-leave").addEventListener("click", leaveOthers);
