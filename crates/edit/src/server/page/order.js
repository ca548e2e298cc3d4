
// Commands, one after the other: each decides on the state that the one before has led to.

const order = { list: [], busy: false, settling: null };

/** Does a command when all before it are answered and the gesture under way has ended. While the pointer moves a joint, none. */
function inOrder(command) {
  if (!now.state) return;
  if (link.way !== "fine") { say("The program has stopped: this can be done when it runs again."); tell(); return; }
  if (now.gesture && now.gesture.pointer) { tell(); return; }
  order.list.push(command);
  if (!order.busy) runCommands();
}
async function runCommands() {
  order.busy = true;
  while (order.list.length) {
    await quiet();
    const command = order.list.shift();
    if (link.way !== "fine") continue;
    try { await command(); } catch (error) { reportError(error); }
  }
  order.busy = false;
  tell();
}
/** Until the gesture under way has arrived and is a step. */
async function quiet() {
  clearTimeout(resting);
  endGesture();
  while (now.gesture && now.gesture.ending) await now.gesture.over;
  await order.settling;
}
/** Moving a joint waits for commands; it is not one of them, so that a gesture can go on. */
const soon = move => order.busy ? inOrder(move) : move();

/** A change of the pose, when it can be changed. */
const doWhenReady = action => () => whenReady(() => act(action));
const doInOrder = action => inOrder(() => act(action));
