// On a phone the picture takes what the panel leaves it, also where the panel is closed.
(() => {
  const follow = new ResizeObserver(([panel]) => {
    const height = innerHeight - panel.target.offsetHeight;
    document.documentElement.style.setProperty('--picture-height', height + 'px');
  });
  let panel = null;
  new MutationObserver(() => {
    const now = document.querySelector('.mantine-Paper-root[style*="position: fixed"]');
    if (now === panel) return;
    follow.disconnect();
    panel = now;
    if (panel) follow.observe(panel);
  }).observe(document, {childList: true, subtree: true});
})();
