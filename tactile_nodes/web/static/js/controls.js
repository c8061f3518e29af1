// The buttons: recording on and off, and a new rest image. The node says what came of it, in a sentence.

const $ = (id) => document.getElementById(id);
const RESTS_MS = 8000;

export class Controls {
  constructor(link) {
    this.link = link;
    this.recording = null;
    this.busy = false;
    this.idle = $('answer').textContent;
    $('record').addEventListener('click', () => this.act(this.recording?.on ? 'recording_stop' : 'recording_start'));
    $('rest').addEventListener('click', () => this.act('rest_image'));
  }

  /** What the nodes offer now, and whether they record. */
  show(slow, isOpen) {
    const { recording, controls } = slow ?? { recording: null, controls: {} };
    this.recording = recording;
    const on = Boolean(recording?.on);
    const may = isOpen && !this.busy && this.link.mayAct;
    $('record').disabled = !may || !controls.recording_start;
    $('rest').disabled = !may || !controls.rest_image;
    $('record').classList.toggle('on', on);
    $('record-word').textContent = on ? `Stop recording, ${recording.seconds.toFixed(0)} s` : 'Record a bag';
    $('recording-mark').hidden = !on;
    if (recording && !recording.well) this.answer(recording.text, 'refused');
    else if (recording?.bag && !this.answered) this.answer(recording.text, '', false);
  }

  async act(action, insist = false) {
    this.busy = true;
    $('record').disabled = $('rest').disabled = true;
    const outcome = await this.link.act(action, insist);
    this.busy = false;
    this.answer(outcome.text, outcome.done ? 'done' : 'refused');
    if (outcome.insistable) this.offer(action);
  }

  /** The person may know better: nothing touches, only the force has drifted. */
  offer(action) {
    const button = document.createElement('button');
    button.type = 'button';
    button.textContent = 'Nothing does: go on';
    button.addEventListener('click', () => this.act(action, true));
    $('answer').append(button);
  }

  answer(text, className, stays = true) {
    const place = $('answer');
    if (place.textContent !== text) place.textContent = text;
    place.className = className;
    place.title = text;
    if (!stays) return;
    clearTimeout(this.answered);
    this.answered = setTimeout(() => {
      this.answered = undefined;
      this.answer(this.idle, '', false);
    }, RESTS_MS);
  }
}
