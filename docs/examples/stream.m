% Prints the corrected rates of one device: device, sample number, time (s since 1970), x, y, z (rad/s).
%   octave-cli stream.m http://127.0.0.1:8090 chest 1000
% Octave 7 or newer. docs/stream.md explains the requests.
words = argv();
url = words{1};
device = words{2};
left = Inf;
if numel(words) > 2
  left = str2double(words{3});
end
after = {};  % where the next request resumes
while left > 0
  address = [url "/api/v1/stream?device=" device sprintf("&after=%s", after{:})];
  if isempty(after)
    address = [url "/api/v1/stream?device=" device];
  end
  try
    said = webread(address, weboptions("Timeout", 30));  % an answer waits up to 10 s for a sample
  catch why  % the dashboard is away, just starts, or does not know the device
    fprintf(stderr, "%s\n", why.message);
    pause(1);
    continue;
  end
  if ischar(said)
    said = jsondecode(said);
  end
  documents = said.documents;
  if isstruct(documents)  % all of one type
    documents = num2cell(documents);
  end
  for k = 1:numel(documents)
    one = documents{k};
    if strcmp(one.type, "missed")
      fprintf(stderr, "%s: %d samples missed from number %d\n", one.device, one.count, one.first);
      continue;
    end
    rate = reshape(one.rate_rad_s, [], 3);
    for i = 1:rows(rate)
      printf("%s,%d,%.6f,%.9g,%.9g,%.9g\n", one.device, one.sequence + i - 1, one.time_s(i), rate(i, :));
    end
    left -= rows(rate);
  end
  after = cellstr(said.after);
end
