// Replay of matches. The data stand in the element #replay-data.
(function () {
  'use strict';
  const root = document.getElementById('replay');
  const data = JSON.parse(document.getElementById('replay-data').textContent);
  const by = (id) => document.getElementById('replay-' + id);
  const canvas = by('board'), line = by('timeline');
  const style = () => getComputedStyle(document.documentElement);
  let colours = {};
  const readColours = () => {
    const own = style(), of = (name) => own.getPropertyValue('--' + name).trim();
    colours = { left: of('blue'), right: of('orange'), none: of('soft'), ball: of('gold'), field: of('head'), wall: of('brown'), line: of('line'), paper: of('paper'), ink: of('ink'), now: of('red') };
  };
  // Width of the drawn walls (m).
  const WALL = 0.012;
  const marks = { block: 5, strike: 9, touch: 3, wall_bounce: 2, goal: 14, rim_out: 8, striker_in_goal: 14, two_biscuits: 14, timeout: 12, ball_lost: 12, restart: 12 };
  const names = { block: 'block', strike: 'strike', touch: 'touch', wall_bounce: 'wall', goal: 'goal', rim_out: 'rim-out', striker_in_goal: 'striker in goal', two_biscuits: 'two biscuits', timeout: 'timeout', ball_lost: 'ball lost', restart: 'restart' };
  let match = data.matches[0], time = 0, playing = false, shown = [], last = null;

  const seconds = (t) => Math.floor(t / 60) + ':' + (t % 60).toFixed(2).padStart(5, '0');

  // Index of the last frame that is not after t.
  function frameAt(t) {
    let low = 0, high = match.t.length - 1;
    while (low < high) {
      const middle = (low + high + 1) >> 1;
      if (match.t[middle] <= t * 1000) { low = middle; } else { high = middle - 1; }
    }
    return low;
  }

  // Place (m) between two frames; absent where either does not see the object or they are far apart.
  function place(track, t) {
    const at = frameAt(t), next = Math.min(at + 1, match.t.length - 1);
    const [a, b] = [at, next].map((k) => track[2 * k] === null ? null : [track[2 * k] / 1e4, track[2 * k + 1] / 1e4]);
    if (!a) { return null; }
    const step = match.t[next] - match.t[at];
    if (!b || step <= 0 || 400 < step) { return a; }
    const share = Math.min(1, Math.max(0, (t * 1000 - match.t[at]) / step));
    return [a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])];
  }

  function size(element) {
    const scale = window.devicePixelRatio || 1, box = element.getBoundingClientRect();
    const width = Math.max(1, Math.round(box.width * scale)), height = Math.max(1, Math.round(box.height * scale));
    if (element.width !== width || element.height !== height) { element.width = width; element.height = height; }
    return [width, height, scale];
  }

  function drawBoard() {
    const [width, , ratio] = size(canvas), ink = canvas.getContext('2d');
    const [short, long] = data.board, px = width / (long + 2 * WALL);
    const at = (p) => [(p[1] + long / 2 + WALL) * px, (p[0] + short / 2 + WALL) * px];
    const disc = (p, radius, fill, stroke, line) => {
      ink.beginPath(); ink.arc(...at(p), radius * px, 0, 7); ink.fillStyle = fill; ink.fill();
      if (stroke) { ink.strokeStyle = stroke; ink.lineWidth = (line || 1.5) * ratio; ink.stroke(); }
    };
    // Walls, field, centre line, and each player's own goal in that player's colour.
    ink.fillStyle = colours.wall; ink.fillRect(0, 0, canvas.width, canvas.height);
    ink.fillStyle = colours.field; ink.fillRect(WALL * px, WALL * px, long * px, short * px);
    ink.strokeStyle = colours.line; ink.lineWidth = 1.5 * ratio; ink.beginPath();
    ink.moveTo(...at([-short / 2, 0])); ink.lineTo(...at([short / 2, 0])); ink.stroke();
    disc([0, -data.cup[0]], data.cup[1], colours.paper, colours.left, 3);
    disc([0, data.cup[0]], data.cup[1], colours.paper, colours.right, 3);
    // The last half second of the ball.
    let before = null;
    for (let k = 30; 0 <= k; k--) {
      const p = place(match.ball, Math.max(0, time - k / 60));
      if (p && before) {
        ink.strokeStyle = colours.ball; ink.globalAlpha = 0.7 * (1 - k / 31); ink.lineWidth = 3 * ratio;
        ink.beginPath(); ink.moveTo(...at(before)); ink.lineTo(...at(p)); ink.stroke();
        ink.globalAlpha = 1;
      }
      before = p;
    }
    for (const side of ['left', 'right']) {
      const p = place(match[side], time);
      if (p) { disc(p, data.radii[1], colours[side]); }
    }
    const ball = place(match.ball, time);
    if (ball) { disc(ball, data.radii[0], colours.ball, colours.ink, 1); }
    for (const event of match.events) {
      const age = time - event.t;
      if (0 <= age && age < 0.6 && event.kind !== 'restart') {
        ink.strokeStyle = colours[event.player] || colours.none; ink.globalAlpha = 1 - age / 0.6; ink.lineWidth = 2;
        ink.beginPath(); ink.arc(...at([event.x, event.y]), (0.012 + 0.02 * age) * px, 0, 7); ink.stroke();
        ink.fillStyle = ink.strokeStyle; ink.font = Math.round(Math.max(12 * ratio, 0.013 * px)) + 'px sans-serif';
        const [x, y] = at([event.x, event.y]);
        ink.textAlign = width * 0.8 < x ? 'right' : 'left';
        ink.fillText(names[event.kind], x + (width * 0.8 < x ? -1 : 1) * 0.016 * px, Math.max(18 * ratio, y - 0.014 * px));
        ink.globalAlpha = 1;
      }
    }
  }

  function drawTimeline() {
    const [width, height, scale] = size(line), ink = line.getContext('2d');
    const x = (t) => 4 + (width - 8) * t / match.duration;
    ink.fillStyle = colours.paper; ink.fillRect(0, 0, width, height);
    match.episodes.forEach((episode, k) => {
      ink.fillStyle = k % 2 ? colours.line : colours.field; ink.fillRect(x(episode.start), 0, Math.max(1, x(episode.end) - x(episode.start)), height);
      ink.fillStyle = colours[episode.scorer] || colours.none; ink.fillRect(x(episode.end) - 2, 0, 3, height);
    });
    for (const event of shown) {
      const long = (marks[event.kind] || 4) * scale, middle = height / 2;
      const y = event.player === 'left' ? middle - long : middle;
      ink.fillStyle = colours[event.player] || colours.none;
      ink.fillRect(x(event.t), event.player ? y : middle - long / 2, Math.max(1, scale), long);
    }
    ink.fillStyle = colours.now; ink.fillRect(x(time) - 1, 0, 2 * scale, height);
  }

  // Points of both players up to now.
  function score() {
    const points = (side) => match.episodes.filter((episode) => episode.scorer === side && episode.end <= time + 1e-6).length;
    by('score').innerHTML = '<span class="left">left <b>' + points('left') + '</b></span>:<span class="right"><b>' + points('right') +
      '</b> right</span><span class="ball">ball: yellow</span>';
    root.dataset.score = points('left') + ':' + points('right');
  }

  function show() {
    by('scrub').value = String(time);
    by('time').textContent = seconds(time) + ' of ' + seconds(match.duration);
    root.dataset.time = time.toFixed(3);
    root.dataset.playing = String(playing);
    score(); drawBoard(); drawTimeline();
  }

  function go(t) { time = Math.min(match.duration, Math.max(0, t)); show(); }

  function setPlaying(on) {
    playing = on;
    if (on && match.duration - 0.01 <= time) { time = 0; }
    by('play').textContent = on ? 'pause' : 'play';
    last = null; show();
    if (on) { requestAnimationFrame(tick); }
  }

  function tick(now) {
    if (!playing) { return; }
    if (last !== null) { time = Math.min(match.duration, time + (now - last) / 1000 * Number(by('speed').value)); }
    last = now;
    if (match.duration <= time) { setPlaying(false); } else { show(); requestAnimationFrame(tick); }
  }

  function list() {
    const kind = by('kind').value;
    shown = match.events.filter((event) => kind === 'all' || (kind === 'touches' ? ['block', 'strike', 'touch'].includes(event.kind) : event.kind === kind));
    const box = by('events');
    box.textContent = '';
    for (const event of shown) {
      const item = document.createElement('button');
      item.type = 'button'; item.dataset.time = event.t; item.dataset.kind = event.kind;
      const speed = ['goal', 'restart', 'timeout', 'striker_in_goal', 'two_biscuits', 'ball_lost'].includes(event.kind) ? '' : ', ' + event.speed_out.toFixed(2) + ' m/s';
      item.textContent = seconds(event.t) + '  ' + names[event.kind] + (event.player ? ', ' + event.player + (['goal', 'rim_out'].includes(event.kind) ? ' cup' : '') : '') + (event.goal_directed ? ', goal-directed' : '') + speed;
      item.addEventListener('click', () => jump(event));
      box.append(item);
    }
    show();
  }

  function jump(event) {
    setPlaying(false); go(event.t);
    for (const item of by('events').children) { item.classList.toggle('now', Number(item.dataset.time) === event.t); }
  }

  function neighbour(direction) {
    const near = direction < 0 ? shown.filter((event) => event.t < time - 1e-6).pop() : shown.find((event) => time + 1e-6 < event.t);
    if (near) {
      jump(near);
      const item = by('events').querySelector('.now');
      if (item) { by('events').scrollTop = item.offsetTop - by('events').offsetTop - 60; }
    }
  }

  function choose(index) {
    match = data.matches[index]; time = 0; playing = false;
    by('play').textContent = 'play';
    by('scrub').max = String(match.duration);
    list();
  }

  by('play').addEventListener('click', () => setPlaying(!playing));
  by('scrub').addEventListener('input', () => go(Number(by('scrub').value)));
  by('match').addEventListener('change', () => choose(Number(by('match').value)));
  by('kind').addEventListener('change', list);
  by('back').addEventListener('click', () => neighbour(-1));
  by('next').addEventListener('click', () => neighbour(1));
  line.addEventListener('click', (click) => {
    const box = line.getBoundingClientRect();
    go((click.clientX - box.left - 4) / (box.width - 8) * match.duration);
  });
  window.addEventListener('resize', show);
  canvas.style.aspectRatio = (data.board[1] + 2 * WALL) + ' / ' + (data.board[0] + 2 * WALL);
  window.matchMedia('(prefers-color-scheme: dark)').addEventListener('change', () => { readColours(); show(); });
  readColours();
  choose(0);
})();
