import json,subprocess,os,time
K=os.environ['KLASKTRON']; cs=json.load(open('cases.json')); res={}
for c in cs:
    d=f'data/{c["machine"]}/{c["case"]}'; t=time.time(); err=''
    for k in (1,2):
        p=subprocess.run([K,'import','csv',f'{d}/r{k}.csv','--time','t','--input','u:'+c['kind'],'--position','q:'+c['pu'],'-o',f'{d}/r{k}.mcap','--overwrite'],capture_output=True,text=True)
        if p.returncode: err+=p.stdout+p.stderr
    cmd=[K,'gap',f'{d}/r1.mcap',f'{d}/r2.mcap','-o',f'{d}/gap','--overwrite','--threads','1']
    if c['case']!='base': cmd+=['--twin',f'data/{c["machine"]}/base/gap/twin.json']
    p=subprocess.run(cmd,capture_output=True,text=True); el=time.time()-t
    j={}
    try:j=json.load(open(f'{d}/gap/gap.json'))
    except Exception as e: err+=repr(e)
    open(f'{d}/out.txt','w').write(p.stdout+'\n---\n'+p.stderr)
    r=dict(machine=c['machine'],case=c['case'],rc=p.returncode,sec=round(el,1),verdict=j.get('verdict'),effects=[e.get('name',e.get('effect')) for e in j.get('effects',[])],err=err)
    res[c['machine']+'/'+c['case']]=r; json.dump(res,open('results.json','w'),indent=1)
    print(r['machine'],r['case'],r['rc'],r['sec'],r['verdict'],r['effects'],err[:200],flush=True)
